//! Errors of the store.

use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why frames cannot be recorded or read back.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StoreError {
    /// A file operation failed.
    #[error("cannot {action} {path}: {reason}")]
    Io {
        /// A verb, for the message.
        action: &'static str,
        path: PathBuf,
        reason: Arc<std::io::Error>,
    },
    /// Another server uses the directory.
    #[error(
        "the data directory {path} is used by another server ({owner}): stop that server, or choose \
         another directory"
    )]
    InUse { path: PathBuf, owner: String },
    /// An MCAP file cannot be written.
    #[error("cannot write to the recording {path}: {}", said(.reason))]
    Mcap { path: PathBuf, reason: Arc<mcap::McapError> },
    /// A quota is used up.
    #[error("{} ({key}): delete maps, or raise the limit", quota(*.used, *.wanted, *.most))]
    Quota {
        /// The setting.
        key: &'static str,
        /// Bytes.
        used: u64,
        /// Bytes that do not fit.
        wanted: u64,
        /// Bytes.
        most: u64,
    },
    /// The recording's thread ended.
    #[error("the recording {path} was closed")]
    Closed { path: PathBuf },
}

/// The words of the innermost error: "no space left on device", not "I/O error".
fn said(error: &mcap::McapError) -> String {
    let mut error: &dyn std::error::Error = error;
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

fn quota(used: u64, wanted: u64, most: u64) -> String {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let (used, wanted, most) = (mib(used), mib(wanted), mib(most));
    format!("{used:.2} of {most:.2} MiB are used, and {wanted:.2} MiB more are needed")
}

impl StoreError {
    /// The reason alone, without a path of the server.
    pub(crate) fn reason(&self) -> String {
        match self {
            Self::Io { reason, .. } => reason.to_string(),
            Self::Mcap { reason, .. } => said(reason),
            Self::InUse { .. } => "another server uses the data directory".into(),
            Self::Quota { .. } => self.to_string(),
            Self::Closed { .. } => "the recording was closed".into(),
        }
    }

    pub(super) fn io(action: &'static str, path: &Path, reason: std::io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), reason: Arc::new(reason) }
    }

    pub(super) fn mcap(path: &Path, reason: mcap::McapError) -> Self {
        Self::Mcap { path: path.to_owned(), reason: Arc::new(reason) }
    }
}
