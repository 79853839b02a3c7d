//! A recording that is received: its folder on disk, which is removed when the recording is mapped.

use super::config::ImportsConfig;
use super::error::ImportError;
use super::room::Room;
use super::unpack::{find, is_record3d, open, unpack};
use crate::store::Store;
use lexsplat_client::dataset::Dataset;
use lexsplat_client::layout::Layout;
use std::io::Read;
use std::path::PathBuf;
use tempfile::TempDir;
use tokio_util::sync::CancellationToken;

/// The folder of a recording that was received.
pub(super) struct Spool {
    folder: TempDir,
    room: Room,
}

impl Spool {
    pub(super) fn new(
        store: &Store,
        limits: &ImportsConfig,
        kept_free: u64,
        stop: CancellationToken,
    ) -> Result<Self, ImportError> {
        let folder = store.temporary_folder().map_err(ImportError::Io)?;
        Ok(Self { folder, room: Room { limits: limits.clone(), kept_free, stop } })
    }

    /// Receives a recording, unpacks it if it is a zip of a folder, and opens it.
    ///
    /// # Errors
    /// [`ImportError`].
    pub(super) fn receive(
        &self,
        mut recording: impl Read,
    ) -> Result<(Layout, Box<dyn Dataset>), ImportError> {
        let path = self.folder.path().join("recording");
        self.room.copy(&mut recording, &path, self.room.limits.max_bytes, ImportError::received)?;
        let layout = Layout::of_content(&path).map_err(ImportError::Io)?;
        let (layout, path) = match layout {
            // Any zip begins so.
            Some(Layout::R3d) => self.unpacked(path)?,
            Some(layout) => (layout, path),
            None => {
                let expected = "expected a file of the kind .mcap, .db3, .r3d or .sens, or a zip of a folder with a \
                                recording, found none of them";
                return Err(ImportError::Refused(expected.into()));
            }
        };
        let opened = layout.open_closed(&path);
        Ok((layout, opened.map_err(|error| self.refused(&error.whole()))?))
    }

    /// The recording in a zip, or the zip if it is one of Record3D.
    fn unpacked(&self, zip: PathBuf) -> Result<(Layout, PathBuf), ImportError> {
        let archive = open(&zip, &self.room.limits)?;
        if is_record3d(&archive) {
            return Ok((Layout::R3d, zip));
        }
        let folder = self.folder.path().join("files");
        unpack(archive, &folder, &self.room)?;
        // The files are what is read from now on.
        std::fs::remove_file(zip).map_err(ImportError::Io)?;
        find(&folder).map_err(|reason| self.refused(&reason))
    }

    /// The error of a recording that cannot be mapped.
    pub(super) fn refused(&self, message: &str) -> ImportError {
        ImportError::Refused(self.plain(message))
    }

    /// A message without the folder's own path.
    pub(super) fn plain(&self, message: &str) -> String {
        let folder = self.folder.path().display().to_string();
        let inside = message.replace(&format!("{folder}/files/"), "");
        inside.replace(&format!("{folder}/files"), "the zip").replace(&format!("{folder}/"), "")
    }
}
