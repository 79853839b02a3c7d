//! A map that somebody sends frames to, with its recorder.

use crate::pipeline::map::{Map, StreamGuard};
use crate::store::{Recorder, StoreError};
use lexsplat_proto::v1;
use std::sync::Arc;

/// The right to send frames to a map; a map has at most one. Dropping it frees the map for the next
/// sender.
pub(crate) struct Recording {
    sender: StreamGuard,
    /// `None` if the server has no data directory.
    recorder: Option<Recorder>,
}

impl Recording {
    pub(super) fn new(sender: StreamGuard, recorder: Option<Recorder>) -> Self {
        Self { sender, recorder }
    }

    pub(crate) fn map(&self) -> &Arc<Map> {
        self.sender.map()
    }

    /// Records a frame; it is on disk when this returns. Does nothing without a data directory.
    ///
    /// # Errors
    /// [`StoreError`]; then the frame is not in the recording and must not be mapped.
    pub(crate) async fn record(&self, frame: v1::Frame) -> Result<(), StoreError> {
        match &self.recorder {
            Some(recorder) => recorder.append(frame).await,
            None => Ok(()),
        }
    }

    /// Whether frames are recorded.
    pub(crate) fn is_recorded(&self) -> bool {
        self.recorder.is_some()
    }

    /// Closes the recording of this stream.
    pub(crate) async fn finish(&self) {
        if let Some(recorder) = &self.recorder {
            recorder.finish().await;
        }
    }
}
