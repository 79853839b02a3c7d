//! What a bridge has done so far, shared by its two sides.

use serde::Serialize;
use std::sync::Mutex;

/// What a bridge tells while it runs.
#[derive(Clone, Debug, PartialEq)]
pub enum BridgeEvent {
    /// Something happened, in words: a connection, a choice of topics, a problem.
    Told(String),
    /// Counts have changed.
    Progress(BridgeProgress),
}

/// Counts of a bridge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BridgeProgress {
    /// Pictures of color that came from the robot.
    pub colors: u64,
    /// Pictures of depth that came from the robot.
    pub depths: u64,
    /// Frames made of both.
    pub frames: u64,
    /// Pictures of color that no depth belongs to.
    pub unpaired: u64,
    /// Frames that were left out because the robot told no pose.
    pub without_pose: u64,
    /// Messages that cannot be read.
    pub damaged: u64,
    /// Frames that were left out because the map could not keep up or the server was away.
    pub dropped: u64,
    /// Frames that the server acknowledged.
    pub acknowledged: u64,
    /// Of these, frames with a pose.
    pub tracked: u64,
    /// Of these, frames that could not be tracked.
    pub lost: u64,
    /// Of these, frames that the server refused.
    pub refused: u64,
    /// How often the robot was connected.
    pub robot_connections: u64,
    /// How often the server was connected.
    pub server_connections: u64,
    /// The last number of a frame that survives a crash of the server.
    pub durable_through: Option<u64>,
}

impl BridgeProgress {
    /// Why there is no frame, in words.
    pub(super) fn missing(&self) -> String {
        match self {
            Self { without_pose: 1.., .. } => format!("{} frames had no pose", self.without_pose),
            Self { damaged: 1.., .. } => format!("{} messages cannot be read", self.damaged),
            Self { colors: 1.., .. } => {
                format!("no depth came with {} color pictures", self.colors)
            }
            _ => "it sent no pictures".into(),
        }
    }
}

/// The counts, and who listens to them.
pub(super) struct Board<'a> {
    progress: Mutex<BridgeProgress>,
    tell: &'a (dyn Fn(BridgeEvent) + Sync),
}

impl<'a> Board<'a> {
    pub(super) fn new(tell: &'a (dyn Fn(BridgeEvent) + Sync)) -> Self {
        Self { progress: Mutex::default(), tell }
    }

    pub(super) fn tell(&self, what: impl Into<String>) {
        (self.tell)(BridgeEvent::Told(what.into()));
    }

    pub(super) fn progress(&self) -> BridgeProgress {
        self.progress.lock().expect("counting does not panic").clone()
    }

    pub(super) fn count(&self, change: impl FnOnce(&mut BridgeProgress)) {
        let mut progress = self.progress.lock().expect("counting does not panic");
        let before = progress.clone();
        change(&mut progress);
        let now = progress.clone();
        drop(progress);
        if now != before {
            (self.tell)(BridgeEvent::Progress(now));
        }
    }
}
