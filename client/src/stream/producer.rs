//! Reads or renders frames ahead and puts them on the wire's queue. Runs on a blocking thread.

use super::ClientError;
use crate::dataset::{Dataset, DatasetError, Mask, RgbdFrame};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use lexsplat_proto::v1::{self, FrameMessage, frame_message::Message};
use nalgebra::Isometry3;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// What to send, and how.
pub(super) struct Producer {
    pub dataset: Arc<dyn Dataset>,
    pub indices: Vec<usize>,
    pub needs_poses: bool,
    pub realtime: bool,
    /// Whether frames carry the data set's masks, which are there.
    pub labels: bool,
    pub hold_out_every: Option<NonZeroUsize>,
    pub frames: mpsc::Sender<FrameMessage>,
}

impl Producer {
    /// Sends everything, or as much as the other side takes: why it stopped taking is its to say.
    pub(super) fn run(self) -> Result<(), ClientError> {
        let mut pace = None;
        for &index in &self.indices {
            let frame = self.dataset.frame(index)?;
            if self.needs_poses && frame.world_from_camera.is_none() {
                return Err(ClientError::NoPose { sequence: frame.sequence });
            }
            if self.realtime {
                pace.get_or_insert_with(|| Pace::new(frame.timestamp_nanos))
                    .wait(frame.timestamp_nanos);
            }
            let sequence = frame.sequence;
            let mut wire = wire(frame);
            wire.held_out = self.is_held_out(index);
            if let Some(truth) = self.dataset.truth().filter(|_| self.labels) {
                wire.set_label_format(v1::LabelFormat::Png);
                wire.labels = labels_png(&truth.mask(index)?, sequence)?.into();
            }
            let message = FrameMessage { message: Some(Message::Frame(wire)) };
            if self.frames.blocking_send(message).is_err() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// The last of every so many frames, by position in the data set.
    fn is_held_out(&self, index: usize) -> bool {
        self.hold_out_every.is_some_and(|every| (index + 1).is_multiple_of(every.get()))
    }
}

/// Instances as a 16-bit grey PNG.
fn labels_png(mask: &Mask, sequence: u64) -> Result<Vec<u8>, DatasetError> {
    // The encoder takes samples in native byte order.
    let samples: Vec<u8> = mask.ids.iter().flat_map(|id| id.to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&samples, mask.width, mask.height, ExtendedColorType::L16)
        .map_err(|source| DatasetError::Encode { sequence, source })?;
    Ok(bytes)
}

/// Holds frames back until their time.
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

/// The frame as it travels.
pub(crate) fn wire(frame: RgbdFrame) -> v1::Frame {
    v1::Frame {
        sequence: frame.sequence,
        timestamp_nanos: frame.timestamp_nanos,
        color_format: frame.color.format.into(),
        color: frame.color.bytes.into(),
        depth_format: frame.depth.format.into(),
        depth: frame.depth.bytes.into(),
        world_from_camera: frame.world_from_camera.as_ref().map(wire_pose),
        pose_covariance: Vec::new(),
        ..v1::Frame::default()
    }
}

fn wire_pose(target_from_source: &Isometry3<f64>) -> v1::Pose {
    let (q, t) = (target_from_source.rotation, target_from_source.translation);
    v1::Pose {
        rotation: Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k }),
        translation_metres: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
    }
}
