//! How far a map is loaded, for those who wait for it.

use std::fmt;

/// How far a map is loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LoadProgress {
    /// Frames that are in the map.
    pub frames_done: u64,
    /// Frames in the recording; 0 if they are not counted yet.
    pub frames_total: u64,
}

impl fmt::Display for LoadProgress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self { frames_total: 0, .. } => formatter.write_str("it waits for its turn"),
            Self { frames_done, frames_total } => {
                write!(formatter, "{frames_done} of {frames_total} frames are in it")
            }
        }
    }
}
