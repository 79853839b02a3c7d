//! Why a message cannot be used.

/// A message that cannot be used; says what was expected and found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// The bytes are no message of its schema.
    #[error("expected a {schema} message: {reason}")]
    Damaged {
        /// Name of the schema.
        schema: &'static str,
        /// What the decoder says.
        reason: String,
    },
    /// The message is whole, but its content cannot be used.
    #[error("{0}")]
    Content(String),
}

impl MessageError {
    pub(super) fn damaged(schema: &'static str, reason: impl std::fmt::Display) -> Self {
        Self::Damaged { schema, reason: reason.to_string() }
    }

    pub(super) fn content(reason: impl Into<String>) -> Self {
        Self::Content(reason.into())
    }
}
