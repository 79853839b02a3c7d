//! Errors of loading and running a network.

/// Why a network does not load or run.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// ONNX Runtime's message.
    #[error("ONNX Runtime: {0}")]
    Runtime(String),
    /// A tensor has another type or shape than the manifest says.
    #[error("tensor {tensor:?}: expected {expected}, found {found}")]
    Tensor {
        /// Name of the tensor.
        tensor: String,
        /// Type and shape; `?` stands for any size.
        expected: String,
        /// Type and shape in the graph.
        found: String,
    },
    /// The tokenizer refused a text.
    #[error("the tokenizer failed: {reason}")]
    Tokenizer {
        /// The tokenizer's message.
        reason: String,
    },
}

impl<R> From<ort::Error<R>> for NetworkError {
    fn from(error: ort::Error<R>) -> Self {
        Self::Runtime(error.message().to_owned())
    }
}
