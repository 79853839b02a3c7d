//! The log of accepted frames: what an acknowledgement's `durable_through` stands for.
//!
//! In: opening messages and accepted frames, as they came over the wire. Out: one append-only file
//! per map, `NAME.log`, under the data directory, and the maps rebuilt from them at the next start.
//! A record is 4 bytes of length, 8 of checksum (both little-endian; the checksum is the start of the
//! payload's SHA-256) and a `FrameMessage`. One thread per open log appends what waits and
//! makes it durable with one `fsync` (group commit). A tail that was cut off while it was written is
//! cut at the next start. Without a data directory nothing is kept, and nobody is told otherwise.

mod log;
mod replay;

pub use log::Log;
pub use replay::replay;

use lexsplat_proto::v1;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What the name of a map's log ends with.
const EXTENSION: &str = "log";

/// Why frames cannot be kept or read back.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The system refused.
    #[error("cannot {action} {path}: {reason}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// What the system says.
        reason: Arc<std::io::Error>,
    },
    /// The log's thread ended because of an earlier failure.
    #[error("the log {path} failed earlier: {reason}")]
    Failed {
        /// The log.
        path: PathBuf,
        /// Its failure.
        reason: String,
    },
}

impl StoreError {
    fn io(action: &'static str, path: &Path, reason: std::io::Error) -> Self {
        Self::Io { action, path: path.to_owned(), reason: Arc::new(reason) }
    }
}

/// Where logs are kept, if anywhere. Cheap to clone.
#[derive(Clone, Default)]
pub struct Store {
    root: Option<Arc<PathBuf>>,
}

impl Store {
    /// A store in `directory`, which is made if it is not there; `None` keeps nothing.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub fn open(directory: Option<&Path>) -> Result<Self, StoreError> {
        let Some(directory) = directory else { return Ok(Self::default()) };
        std::fs::create_dir_all(directory)
            .map_err(|reason| StoreError::io("make the data directory", directory, reason))?;
        Ok(Self { root: Some(Arc::new(directory.to_owned())) })
    }

    /// The log of the map that `open` opens, ready to append to; `None` if nothing is kept.
    ///
    /// Only the map's one sender may hold it.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub async fn log(&self, open: &v1::OpenMap) -> Result<Option<Arc<Log>>, StoreError> {
        let Some(root) = &self.root else { return Ok(None) };
        let path = log_path(root, &open.map);
        let open = open.clone();
        let log = tokio::task::spawn_blocking(move || Log::open(path, open))
            .await
            .expect("opening a log does not panic")?;
        Ok(Some(Arc::new(log)))
    }

    /// Removes the map's log, if there is one.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub async fn forget(&self, map: &str) -> Result<(), StoreError> {
        let Some(root) = &self.root else { return Ok(()) };
        let path = log_path(root, map);
        match tokio::fs::remove_file(&path).await {
            Err(reason) if reason.kind() != std::io::ErrorKind::NotFound => {
                Err(StoreError::io("remove", &path, reason))
            }
            _ => Ok(()),
        }
    }

    /// Names of the maps that have logs, in order.
    fn maps(&self) -> Result<Vec<String>, StoreError> {
        let Some(root) = &self.root else { return Ok(Vec::new()) };
        let failed = |reason| StoreError::io("list", root, reason);
        let mut names = Vec::new();
        for entry in std::fs::read_dir(root.as_path()).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_some_and(|extension| extension == EXTENSION) {
                names.extend(path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned));
            }
        }
        names.sort();
        Ok(names)
    }
}

/// `map` is a name that the engine has checked: it has no separators and no dot first.
fn log_path(root: &Path, map: &str) -> PathBuf {
    root.join(format!("{map}.{EXTENSION}"))
}
