//! Text embeddings.

mod cache;
mod embedder;

pub(super) use embedder::{TextEmbedder, wanted};
