//! Limits on the data directory, section `recording`.

use crate::pipeline::range::{OutOfRange, require};
use serde::{Deserialize, Serialize};

/// Limits on the data directory, section `recording`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingConfig {
    /// Bytes that all maps may have in the data directory; 0: no limit.
    pub max_bytes: u64,
    /// Bytes that one map may have there; 0: no limit.
    pub max_map_bytes: u64,
    /// Below this many free bytes, on the disk or below `max_bytes`, the server warns.
    pub low_bytes: u64,
}

impl Default for RecordingConfig {
    fn default() -> Self {
        Self { max_bytes: 0, max_map_bytes: 0, low_bytes: 1 << 30 }
    }
}

impl RecordingConfig {
    /// Checks that the limits fit together.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        let Self { max_bytes, max_map_bytes, .. } = *self;
        require(
            max_bytes == 0 || max_map_bytes <= max_bytes,
            "recording.max_map_bytes",
            max_map_bytes,
            format!("at most recording.max_bytes, which is {max_bytes}"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn limits_are_checked() {
        assert_checks(
            "recording",
            RecordingConfig::check,
            &[(
                "recording.max_map_bytes",
                |c| (c.max_bytes, c.max_map_bytes) = (10, 11),
                |c| (c.max_bytes, c.max_map_bytes) = (10, 10),
            )],
            &["recording.max_bytes", "recording.low_bytes"],
        );
    }
}
