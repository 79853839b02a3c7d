//! Errors of the encoder.

use crate::pipeline::network::NetworkError;

/// Why a keyframe has no language.
#[derive(Debug, thiserror::Error)]
pub enum LanguageError {
    /// A network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A label's text cannot be embedded.
    #[error("a label's text cannot be embedded: {reason}")]
    Text {
        /// The text tower's message.
        reason: String,
    },
    /// A frame has labels, and the bundle cannot compress the embeddings of their texts.
    #[error("labels were given, but the bundle has no compressor: name one in compressor.encoder")]
    NoCompressor,
}
