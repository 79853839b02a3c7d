//! A recording that is received: its folder on disk, which is removed when the recording is mapped.

use super::config::ImportsConfig;
use super::error::ImportError;
use super::unpack::{find, is_record3d, unpack};
use crate::store::Store;
use lexsplat_client::dataset::Dataset;
use lexsplat_client::layout::Layout;
use std::fs::File;
use std::io::{Read, Write as _};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Bytes that are copied at once, and between two looks at the free space.
const BLOCK: usize = 1 << 20;
const LOOK_EVERY: u64 = 64 << 20;

/// The folder of a recording that was received.
pub(super) struct Spool {
    folder: TempDir,
    limits: ImportsConfig,
    /// Bytes that must stay free on the disk.
    kept_free: u64,
}

impl Spool {
    pub(super) fn new(
        store: &Store,
        limits: &ImportsConfig,
        kept_free: u64,
    ) -> Result<Self, ImportError> {
        let folder = store.temporary_folder().map_err(ImportError::Io)?;
        Ok(Self { folder, limits: limits.clone(), kept_free })
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
        self.copy(&mut recording, &path, self.limits.max_bytes, ImportError::received)?;
        let layout = Layout::of_content(&path).map_err(ImportError::Io)?;
        let (layout, path) = match layout {
            Some(Layout::R3d) if !is_record3d(&path) => self.unpacked(&path)?,
            Some(layout) => (layout, path),
            None => {
                let expected = "expected a file of the kind .mcap, .db3, .r3d or .sens, or a zip of a folder with a \
                                recording, found none of them";
                return Err(ImportError::Refused(expected.into()));
            }
        };
        let opened = layout.open_closed(&path);
        Ok((layout, opened.map_err(|error| ImportError::Refused(self.plain(&error.whole())))?))
    }

    fn unpacked(&self, zip: &Path) -> Result<(Layout, PathBuf), ImportError> {
        let folder = self.folder.path().join("files");
        unpack(zip, &folder, self)?;
        // The files are what is read from now on.
        std::fs::remove_file(zip).map_err(ImportError::Io)?;
        find(&folder).map_err(|reason| ImportError::Refused(self.plain(&reason)))
    }

    pub(super) fn limits(&self) -> &ImportsConfig {
        &self.limits
    }

    /// A message without the folder's own path.
    pub(super) fn plain(&self, message: &str) -> String {
        let folder = self.folder.path().display().to_string();
        let inside = message.replace(&format!("{folder}/files/"), "");
        inside.replace(&format!("{folder}/files"), "the zip").replace(&format!("{folder}/"), "")
    }

    /// Copies a file of at most so many bytes; returns how many it has. `failed` turns errors of reading.
    pub(super) fn copy(
        &self,
        from: &mut impl Read,
        to: &Path,
        most: u64,
        failed: impl Fn(&std::io::Error) -> ImportError,
    ) -> Result<u64, ImportError> {
        let mut file = File::create_new(to).map_err(ImportError::Io)?;
        let (mut block, mut bytes, mut looked) = (vec![0; BLOCK], 0, None);
        loop {
            let read = from.read(&mut block).map_err(|error| failed(&error))?;
            if read == 0 {
                return Ok(bytes);
            }
            bytes += read as u64;
            if bytes > most {
                return Err(ImportError::TooLarge { most: self.limits.max_bytes });
            }
            if looked.is_none_or(|at| bytes - at > LOOK_EVERY) {
                self.expect_room()?;
                looked = Some(bytes);
            }
            file.write_all(&block[..read]).map_err(ImportError::Io)?;
        }
    }

    fn expect_room(&self) -> Result<(), ImportError> {
        let disk = rustix::fs::statvfs(self.folder.path());
        let disk = disk.map_err(|error| ImportError::Io(error.into()))?;
        let (free, kept) = (disk.f_bavail.saturating_mul(disk.f_frsize), self.kept_free);
        if free < kept.saturating_add(LOOK_EVERY) {
            return Err(ImportError::NoRoom { free, kept });
        }
        Ok(())
    }
}
