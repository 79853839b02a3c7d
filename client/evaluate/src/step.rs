//! Progress of an evaluation.

use lexsplat_client::http::Status;
use lexsplat_client::stream::Progress;

/// The step that an evaluation is at; `done` of `of` parts of it are finished.
#[derive(Clone, Copy, Debug)]
pub enum Step<'a> {
    /// The probe is running, before the run or after it.
    Probing,
    /// Frames are being sent.
    Streaming(&'a Progress),
    /// The server is optimising the map.
    Settling(&'a Status),
    /// Views are being rendered and compared with frames.
    Rendering {
        /// Views finished.
        done: usize,
        /// Views in all.
        of: usize,
    },
    /// Queries about the whole map are being asked.
    Locating {
        /// Queries answered.
        done: usize,
        /// Queries in all.
        of: usize,
    },
    /// Queries for objects that are absent are being asked.
    Judging {
        /// Views finished.
        done: usize,
        /// Views in all.
        of: usize,
    },
    /// Queries about frames are being asked.
    Asking {
        /// Frames finished.
        done: usize,
        /// Frames in all.
        of: usize,
    },
}
