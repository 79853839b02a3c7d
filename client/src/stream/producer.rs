//! Reads or renders frames ahead of the wire, on a blocking thread.

use super::connection::FrameSender;
use super::error::ClientError;
use super::wire;
use crate::dataset::{Dataset, DatasetError, Mask};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use lexsplat_proto::v1;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Sends the frames of a data set.
pub(super) struct Producer {
    pub dataset: Arc<dyn Dataset>,
    pub indices: Vec<usize>,
    pub needs_poses: bool,
    pub realtime: bool,
    /// Whether frames carry the data set's masks; it must have some.
    pub labels: bool,
    pub hold_out_every: Option<NonZeroUsize>,
    pub frames: FrameSender,
}

impl Producer {
    /// Sends the frames that can be read, or stops when the stream has ended; the acknowledgements have the
    /// reason. Returns the frames that were left out, each with its error.
    pub(super) fn run(self) -> Vec<(u64, ClientError)> {
        let (mut pace, mut left_out) = (None, Vec::new());
        for &index in &self.indices {
            let wire = match self.read(index) {
                Ok(wire) => wire,
                Err(error) => {
                    left_out.push((self.dataset.sequence(index), error));
                    continue;
                }
            };
            if self.realtime {
                pace.get_or_insert_with(|| Pace::new(wire.timestamp_nanos))
                    .wait(wire.timestamp_nanos);
            }
            if !self.frames.blocking_send(wire) {
                break;
            }
        }
        left_out
    }

    fn read(&self, index: usize) -> Result<v1::Frame, ClientError> {
        let frame = self.dataset.frame(index)?;
        let sequence = frame.sequence;
        if self.needs_poses && frame.world_from_camera.is_none() {
            return Err(ClientError::NoPose { sequence });
        }
        let mut wire = wire::frame(frame);
        wire.held_out = self.is_held_out(index);
        if let Some(truth) = self.dataset.truth().filter(|_| self.labels) {
            wire.set_label_format(v1::LabelFormat::Png);
            wire.labels = labels_png(&truth.mask(index)?, sequence)?.into();
        }
        Ok(wire)
    }

    /// Whether a frame is held out: the last of every N, by position in the data set.
    fn is_held_out(&self, index: usize) -> bool {
        self.hold_out_every.is_some_and(|every| (index + 1).is_multiple_of(every.get()))
    }
}

/// Instance ids as a 16-bit grey PNG.
fn labels_png(mask: &Mask, sequence: u64) -> Result<Vec<u8>, DatasetError> {
    // The encoder takes samples in native byte order.
    let samples: Vec<u8> = mask.ids.iter().flat_map(|id| id.to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&samples, mask.width, mask.height, ExtendedColorType::L16)
        .map_err(|source| DatasetError::Encode { sequence, source })?;
    Ok(bytes)
}

/// Delays frames to the pace of their timestamps.
struct Pace {
    first_nanos: u64,
    started: Instant,
}

impl Pace {
    fn new(first_nanos: u64) -> Self {
        Self { first_nanos, started: Instant::now() }
    }

    fn wait(&self, nanos: u64) {
        let due = Duration::from_nanos(nanos.saturating_sub(self.first_nanos));
        std::thread::sleep(due.saturating_sub(self.started.elapsed()));
    }
}
