//! Errors of the store.

use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why frames cannot be recorded or read back.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file operation failed.
    #[error("cannot {action} {path}: {reason}")]
    Io {
        /// A verb, for the message.
        action: &'static str,
        path: PathBuf,
        reason: Arc<std::io::Error>,
    },
    /// The log's thread ended because an earlier write failed.
    #[error("an earlier write to the log {path} failed: {reason}")]
    Failed { path: PathBuf, reason: String },
}

impl StoreError {
    pub(super) fn io(action: &'static str, path: &Path, reason: std::io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), reason: Arc::new(reason) }
    }
}
