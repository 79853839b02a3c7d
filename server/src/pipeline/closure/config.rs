//! Settings of loop closure, section `[closure]`.

use super::super::range::{MAX_COUNT, OutOfRange, at_least, within};
use serde::{Deserialize, Serialize};

/// How loops are closed. Only estimated poses are corrected.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClosureConfig {
    /// Whether loops are looked for. Off by default: on long walks of a noisy camera poses can become worse.
    pub enabled: bool,
    /// A keyframe whose surfaces may be misplaced by more than this relative to the newest one (standard
    /// deviation, metres) is no reference of the tracker until a loop is closed.
    pub connected_metres: f64,
    /// Such a keyframe is compared with a new one if a camera there sees at least this share of it,
    pub overlap: f64,
    /// and is one of this many that share most features with it.
    pub candidates: usize,
    /// The map is moved if a keyframe's surfaces are corrected by more than this, metres.
    pub correction_metres: f64,
}

impl ClosureConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        at_least("closure.connected_metres", self.connected_metres, 0.0)?;
        within("closure.overlap", self.overlap, 0.0..=1.0)?;
        within("closure.candidates", self.candidates, 1..=MAX_COUNT)?;
        at_least("closure.correction_metres", self.correction_metres, 0.0)
    }
}

impl Default for ClosureConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            connected_metres: 0.02,
            overlap: 0.3,
            candidates: 4,
            correction_metres: 0.01,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::range::table::{Case, assert_checks};
    use super::*;

    const CASES: &[Case<ClosureConfig>] = &[
        ("closure.connected_metres", |c| c.connected_metres = -0.1, |c| c.connected_metres = 0.0),
        ("closure.overlap", |c| c.overlap = 1.1, |c| c.overlap = 1.0),
        ("closure.candidates", |c| c.candidates = 0, |c| c.candidates = 1),
        (
            "closure.correction_metres",
            |c| c.correction_metres = f64::NAN,
            |c| c.correction_metres = 0.0,
        ),
    ];

    #[test]
    fn each_number_is_checked() {
        assert_checks("closure", ClosureConfig::check, CASES, &[]);
    }
}
