//! Why a recording is not imported.

use crate::maps::MapsError;
use lexsplat_client::stream::ClientError;
use std::io::ErrorKind;
use tonic::Code;

/// Why a recording is not imported. Messages say what to do.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ImportError {
    #[error(transparent)]
    Maps(#[from] MapsError),
    #[error("as many recordings as the server takes at a time are being mapped: try again later")]
    Busy,
    #[error(
        "the map {map:?} has frames already, up to number {newest}: choose another name, or say that the recording \
             goes on behind them (resume=true): frames up to that number are then left out"
    )]
    HasFrames { map: String, newest: u64 },
    #[error("a recording is being mapped into {map:?} already: wait for it, or stop it")]
    Already { map: String },
    #[error("{reason}: send it faster")]
    Slow { reason: String },
    #[error("the recording has more than {most} bytes (imports.max_bytes)")]
    TooLarge { most: u64 },
    #[error(
        "the disk has no room for the recording: {free} bytes are free, and {kept} are kept free"
    )]
    NoRoom { free: u64, kept: u64 },
    /// It is no recording, or none that can be mapped.
    #[error("{0}")]
    Refused(String),
    #[error("the recording did not arrive as a whole: {0}")]
    Broken(String),
    #[error("cannot keep the recording: {0}")]
    Io(std::io::Error),
    /// The map does not take its frames.
    #[error("{message}")]
    Stream { code: Code, message: String },
    #[error("somebody stopped it")]
    Stopped,
    #[error("reading the recording panicked: the server's log has the message")]
    Panicked,
}

impl ImportError {
    /// An error of whoever sends the recording.
    pub(super) fn received(error: &std::io::Error) -> Self {
        match error.kind() {
            ErrorKind::TimedOut => Self::Slow { reason: error.to_string() },
            _ => Self::Broken(error.to_string()),
        }
    }
}

impl From<ClientError> for ImportError {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Refused { code, message, .. } => Self::Stream { code, message },
            ClientError::Dataset(error) => Self::Refused(error.whole()),
            ClientError::Panicked => Self::Panicked,
            other => Self::Stream { code: Code::Internal, message: other.to_string() },
        }
    }
}
