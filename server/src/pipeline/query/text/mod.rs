//! Text embeddings.

mod cache;
mod embedder;
mod subject;

pub(super) use embedder::TextEmbedder;
