//! What a bridge connects, and why it ends.

use crate::access::Access;
use crate::rig::Wanted;
use crate::stream::{ClientError, Poses};
use std::time::Duration;

/// What a bridge connects.
#[derive(Clone, Debug)]
pub struct BridgeOptions {
    /// The robot: `ws://HOST:PORT`, `wss://HOST:PORT` or `HOST:PORT`.
    pub robot: String,
    /// The server's gRPC address, as in [`StreamOptions`](crate::stream::StreamOptions).
    pub grpc: String,
    /// Token and certificates of the server.
    pub access: Access,
    /// Name of the map to create or resume.
    pub map: String,
    /// Where poses come from; `None`: from the robot if it tells any, else the server estimates them.
    pub poses: Option<Poses>,
    /// Topics and frames of coordinates to use; what is absent is chosen by content.
    pub wanted: Wanted,
    /// After how many acknowledged frames the bridge ends; `None`: never.
    pub frames: Option<u64>,
}

impl BridgeOptions {
    /// A bridge that chooses everything by what the robot sends, to a server that asks nobody who is calling.
    pub fn new(robot: &str, grpc: &str, map: &str) -> Self {
        Self {
            robot: robot.into(),
            grpc: grpc.into(),
            access: Access::default(),
            map: map.into(),
            poses: None,
            wanted: Wanted::default(),
            frames: None,
        }
    }
}

/// Why a bridge cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The robot's address cannot be used.
    #[error("robot: expected ws://HOST:PORT, found {found:?}: {reason}")]
    Address {
        /// The text that was given.
        found: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The map cannot be called so.
    #[error("map: expected 1 to 64 of A-Z a-z 0-9 . _ - and not a dot first, found {found:?}")]
    Name {
        /// The text that was given.
        found: String,
    },
    /// Something else than a robot answers at its address.
    #[error(
        "{robot} is no robot that can be read: {reason}; start foxglove_bridge on the robot and give its port, as a \
         rule 8765"
    )]
    NoRobot {
        /// The robot's address.
        robot: String,
        /// What answers there.
        reason: String,
    },
    /// The bridge was stopped before any frame came.
    #[error("no frame came from {robot}: {reason}")]
    NoFrames {
        /// The robot's address.
        robot: String,
        /// What was missing at last.
        reason: String,
    },
    /// The server refuses the map or its frames, or its address is wrong.
    #[error(transparent)]
    Server(#[from] ClientError),
}

/// Growing waits between two tries.
pub(super) struct Waits(Duration);

impl Waits {
    const FIRST: Duration = Duration::from_millis(500);
    const LONGEST: Duration = Duration::from_secs(30);

    pub(super) fn new() -> Self {
        Self(Self::FIRST)
    }

    /// The next wait, twice as long as the one before.
    pub(super) fn next(&mut self) -> Duration {
        let wait = self.0;
        self.0 = (2 * wait).min(Self::LONGEST);
        wait
    }
}
