//! Limits on uploaded recordings, section `imports`.

use crate::pipeline::range::{OutOfRange, within};
use serde::{Deserialize, Serialize};

/// Most bytes that can be set: a petabyte.
const MOST_BYTES: u64 = 1 << 50;
const MOST_FILES: u64 = 1 << 32;

/// Limits on uploaded recordings, section `imports`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImportsConfig {
    /// The largest recording, bytes, as it is sent and after it is unpacked.
    pub max_bytes: u64,
    /// Most files that a zip may have.
    pub max_files: u64,
    /// Recordings that are received or mapped at a time.
    pub at_once: usize,
}

impl Default for ImportsConfig {
    fn default() -> Self {
        Self { max_bytes: 16 << 30, max_files: 200_000, at_once: 2 }
    }
}

impl ImportsConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("imports.max_bytes", self.max_bytes, 1..=MOST_BYTES)?;
        within("imports.max_files", self.max_files, 1..=MOST_FILES)?;
        within("imports.at_once", self.at_once, 1..=1024)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn limits_are_checked() {
        assert_checks(
            "imports",
            ImportsConfig::check,
            &[
                ("imports.max_bytes", |c| c.max_bytes = 0, |c| c.max_bytes = 1),
                ("imports.max_files", |c| c.max_files = 0, |c| c.max_files = 1),
                ("imports.at_once", |c| c.at_once = 0, |c| c.at_once = 1),
            ],
            &[],
        );
    }
}
