//! Settings of the gRPC edge, section `[ingest]`.

use crate::pipeline::range::{OutOfRange, at_least, require};
use serde::{Deserialize, Serialize};

/// What is taken from robots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IngestConfig {
    /// The longest gRPC message, bytes.
    pub max_message_bytes: usize,
    /// The largest image, pixels; larger ones are refused before they are decoded.
    pub max_pixels: u64,
    /// Depth below this is no measurement, metres.
    pub min_depth_metres: f32,
    /// Depth above this is no measurement, metres.
    pub max_depth_metres: f32,
    /// Acknowledgements that a stream may have outstanding before it is read no further.
    pub ack_backlog: usize,
    /// How long a sender may take to read an acknowledgement, seconds.
    pub ack_seconds: u64,
    /// How long a stream may take to send its opening message, seconds.
    pub open_seconds: u64,
    /// How often a silent connection is asked whether it is still there, seconds.
    pub keepalive_seconds: u64,
    /// How long it may take to answer that, seconds.
    pub keepalive_timeout_seconds: u64,
}

impl Default for IngestConfig {
    fn default() -> Self {
        Self {
            max_message_bytes: 64 << 20,
            max_pixels: 16 << 20,
            min_depth_metres: 0.01,
            max_depth_metres: 100.0,
            ack_backlog: 64,
            ack_seconds: 60,
            open_seconds: 30,
            keepalive_seconds: 20,
            keepalive_timeout_seconds: 20,
        }
    }
}

impl IngestConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        at_least("ingest.max_message_bytes", self.max_message_bytes, 1)?;
        at_least("ingest.max_pixels", self.max_pixels, 1)?;
        at_least("ingest.ack_backlog", self.ack_backlog, 1)?;
        at_least("ingest.ack_seconds", self.ack_seconds, 1)?;
        at_least("ingest.open_seconds", self.open_seconds, 1)?;
        at_least("ingest.keepalive_seconds", self.keepalive_seconds, 1)?;
        at_least("ingest.keepalive_timeout_seconds", self.keepalive_timeout_seconds, 1)?;
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
                (
                    "ingest.keepalive_seconds",
                    |c| c.keepalive_seconds = 0,
                    |c| c.keepalive_seconds = 1,
                ),
                (
                    "ingest.keepalive_timeout_seconds",
                    |c| c.keepalive_timeout_seconds = 0,
                    |c| c.keepalive_timeout_seconds = 1,
                ),
            ],
            &[],
        );
    }
}
