//! Settings of the gRPC interface, section `ingest`.

use crate::check::Limits;
use crate::pipeline::range::{
    DAY, MAX_BYTES, MAX_KEPT, MAX_PIXELS, OutOfRange, at_least, require, within,
};
use serde::{Deserialize, Serialize};

/// The longest message that can be set, bytes: its frame has to fit into a record of a recording.
const MAX_MESSAGE_BYTES: usize = 1 << 29;

/// Limits on streams of frames: sizes and times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IngestConfig {
    /// The longest gRPC message, bytes; a longer one ends its stream. The largest frame of `max_pixels` has
    /// 9 bytes a pixel: raw color, depth as float32, and labels.
    pub max_message_bytes: usize,
    /// Bytes that messages may have together before they are complete; above it the call with the most ends.
    pub max_unfinished_bytes: usize,
    /// How long a message may take from its first byte to its last, seconds.
    pub message_seconds: u64,
    /// The largest image, pixels; larger images are refused before they are decoded.
    pub max_pixels: u64,
    /// Most by which the sequence number of a frame may exceed the one before.
    pub max_sequence_step: u64,
    /// Smaller depths are treated as no measurement, metres.
    pub min_depth_metres: f32,
    /// Larger depths are treated as no measurement, metres.
    pub max_depth_metres: f32,
    /// Unread acknowledgements of a stream; with more, the server stops reading its frames.
    pub ack_backlog: usize,
    /// How long a sender may take to read an acknowledgement, seconds.
    pub ack_seconds: u64,
    /// How long a stream may take to send its opening message, seconds.
    pub open_seconds: u64,
}

impl Default for IngestConfig {
    fn default() -> Self {
        Self {
            max_message_bytes: 160 << 20,
            max_unfinished_bytes: 512 << 20,
            message_seconds: 120,
            max_pixels: 16 << 20,
            max_sequence_step: 1_000_000_000_000_000,
            min_depth_metres: 0.01,
            max_depth_metres: 100.0,
            ack_backlog: 64,
            ack_seconds: 60,
            open_seconds: 30,
        }
    }
}

impl IngestConfig {
    /// The limits on frames and cameras.
    pub(crate) fn limits(&self) -> Limits {
        Limits {
            max_pixels: self.max_pixels,
            max_sequence_step: self.max_sequence_step,
            min_depth_metres: self.min_depth_metres,
            max_depth_metres: self.max_depth_metres,
        }
    }

    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("ingest.max_message_bytes", self.max_message_bytes, 1..=MAX_MESSAGE_BYTES)?;
        let most = self.max_message_bytes;
        require(
            (most..=MAX_BYTES).contains(&self.max_unfinished_bytes),
            "ingest.max_unfinished_bytes",
            self.max_unfinished_bytes,
            format!("ingest.max_message_bytes, which is {most}, to {MAX_BYTES}"),
        )?;
        within("ingest.message_seconds", self.message_seconds, 1..=DAY)?;
        within("ingest.max_pixels", self.max_pixels, 1..=MAX_PIXELS)?;
        at_least("ingest.max_sequence_step", self.max_sequence_step, 1)?;
        within("ingest.ack_backlog", self.ack_backlog, 1..=MAX_KEPT)?;
        within("ingest.ack_seconds", self.ack_seconds, 1..=DAY)?;
        within("ingest.open_seconds", self.open_seconds, 1..=DAY)?;
        let (near, far) = (self.min_depth_metres, self.max_depth_metres);
        at_least("ingest.min_depth_metres", near, 0.0)?;
        require(
            far > near && far.is_finite(),
            "ingest.max_depth_metres",
            far,
            format!("a finite number, more than ingest.min_depth_metres, which is {near}"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;
    use lexsplat_proto::v1;
    use prost::Message as _;

    #[test]
    fn the_largest_raw_frame_fits_into_a_message() {
        let IngestConfig { max_message_bytes, max_pixels, .. } = IngestConfig::default();
        let bytes = |pixels: u64, each: u64| (pixels * each) as usize;
        // Color, depth as float32, and labels of 16 bits.
        let raw = v1::Frame {
            color: vec![0; bytes(max_pixels, 3)].into(),
            depth: vec![0; bytes(max_pixels, 4)].into(),
            labels: vec![0; bytes(max_pixels, 2)].into(),
            ..v1::Frame::default()
        };
        assert!(raw.encoded_len() + 1024 < max_message_bytes, "{} bytes", raw.encoded_len());
    }

    #[test]
    fn each_number_is_checked() {
        assert_checks(
            "ingest",
            IngestConfig::check,
            &[
                (
                    "ingest.max_message_bytes",
                    |c| c.max_message_bytes = 0,
                    |c| c.max_message_bytes = 1,
                ),
                (
                    "ingest.max_unfinished_bytes",
                    |c| c.max_unfinished_bytes = c.max_message_bytes - 1,
                    |c| c.max_unfinished_bytes = c.max_message_bytes,
                ),
                ("ingest.message_seconds", |c| c.message_seconds = 0, |c| c.message_seconds = 1),
                (
                    "ingest.max_sequence_step",
                    |c| c.max_sequence_step = 0,
                    |c| c.max_sequence_step = 1,
                ),
                ("ingest.max_pixels", |c| c.max_pixels = 0, |c| c.max_pixels = 1),
                (
                    "ingest.min_depth_metres",
                    |c| c.min_depth_metres = -0.1,
                    |c| c.min_depth_metres = 0.0,
                ),
                (
                    "ingest.max_depth_metres",
                    |c| c.max_depth_metres = 0.01,
                    |c| c.max_depth_metres = 0.02,
                ),
                (
                    "ingest.max_depth_metres",
                    |c| c.max_depth_metres = f32::INFINITY,
                    |c| c.max_depth_metres = 1e3,
                ),
                ("ingest.ack_backlog", |c| c.ack_backlog = 0, |c| c.ack_backlog = 1),
                ("ingest.ack_seconds", |c| c.ack_seconds = 0, |c| c.ack_seconds = 1),
                ("ingest.open_seconds", |c| c.open_seconds = 0, |c| c.open_seconds = 1),
            ],
            &[],
        );
    }
}
