//! Logs of accepted frames, so that maps survive a crash or a restart of the server.
//!
//! In: opening messages and accepted frames, as they came over the wire. Out: one append-only file
//! for each map, `NAME.log`, in the data directory. Without a data directory nothing is recorded.
//!
//! A record is 4 bytes of length, 8 bytes of checksum (the start of the payload's SHA-256) and a
//! `FrameMessage`; length and checksum are little-endian. One thread for each open log appends all
//! waiting frames and makes them durable with one `fsync` (group commit). A record that was only
//! partly written is cut off when the log is opened again.

mod error;
mod log;
mod record;

pub(crate) use error::StoreError;
pub(crate) use log::Log;
pub(crate) use record::Records;

use lexsplat_proto::v1;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Extension of log files.
const EXTENSION: &str = "log";

/// The data directory with the logs. Cheap to clone.
#[derive(Clone, Default)]
pub(crate) struct Store {
    /// `None`: nothing is recorded.
    root: Option<Arc<PathBuf>>,
}

/// The log of a map, not opened.
pub(crate) struct LogFile {
    pub(crate) map: String,
    path: PathBuf,
}

impl Store {
    /// A store in `directory`, which is created if needed; with `None` nothing is recorded.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn open(directory: Option<&Path>) -> Result<Self, StoreError> {
        let Some(directory) = directory else { return Ok(Self::default()) };
        std::fs::create_dir_all(directory)
            .map_err(|reason| StoreError::io("create the data directory", directory, reason))?;
        Ok(Self { root: Some(Arc::new(directory.to_owned())) })
    }

    /// Opens the log of the map that `open` names; `None` if nothing is recorded.
    ///
    /// Only the map's one sender may call this.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) async fn log(&self, open: &v1::OpenMap) -> Result<Option<Arc<Log>>, StoreError> {
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
    pub(crate) async fn forget(&self, map: &str) -> Result<(), StoreError> {
        let Some(root) = &self.root else { return Ok(()) };
        let path = log_path(root, map);
        match tokio::fs::remove_file(&path).await {
            Err(reason) if reason.kind() != std::io::ErrorKind::NotFound => {
                Err(StoreError::io("remove", &path, reason))
            }
            _ => Ok(()),
        }
    }

    /// All logs, sorted by the names of their maps.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn logs(&self) -> Result<Vec<LogFile>, StoreError> {
        let Some(root) = &self.root else { return Ok(Vec::new()) };
        let failed = |reason| StoreError::io("list", root, reason);
        let mut logs = Vec::new();
        for entry in std::fs::read_dir(root.as_path()).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_some_and(|extension| extension == EXTENSION) {
                let map = path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned);
                logs.extend(map.map(|map| LogFile { map, path }));
            }
        }
        logs.sort_by(|a, b| a.map.cmp(&b.map));
        Ok(logs)
    }
}

impl LogFile {
    /// Opens the log for reading, after cutting off a record that was only partly written.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn records(&self) -> Result<Records, StoreError> {
        record::cut_torn_tail(&self.path)?;
        Records::open(&self.path)
    }
}

/// Path of a map's log. The engine has checked the name: it has no path separators and does not
/// start with a dot.
fn log_path(root: &Path, map: &str) -> PathBuf {
    root.join(format!("{map}.{EXTENSION}"))
}
