//! Why topics cannot be put together.

/// Topics that give no RGB-D frames; says what was expected and found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RigError {
    /// A topic that is needed is not there.
    #[error("expected {expected}, found {found}")]
    Missing {
        /// What was looked for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A topic that was asked for cannot be used so.
    #[error("{option}={value}: expected {expected}")]
    Wanted {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        expected: String,
    },
    /// A camera cannot be used.
    #[error("{topic}: {reason}")]
    Camera {
        /// The topic of its calibration.
        topic: String,
        /// What is wrong with it.
        reason: String,
    },
}
