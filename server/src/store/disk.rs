//! The operations by which the store changes the disk. All of them are here, so that tests can put a disk
//! beneath it that fails, or that loses in a crash what was not synced.

use std::fs::OpenOptions;
use std::io::{Result, Seek, Write};
use std::path::Path;

/// Changes files and folders. A change of a folder (a new, renamed or removed entry) survives a crash once
/// the folder is synced, data of a file once the file is.
pub(super) trait Disk: Send + Sync {
    /// Creates a file, which must not exist.
    fn create(&self, path: &Path) -> Result<Box<dyn DiskFile>>;

    /// Creates a folder, unless it is there.
    fn create_folder(&self, path: &Path) -> Result<()>;

    /// Renames a file or a folder. A file of the new name is replaced.
    fn rename(&self, from: &Path, to: &Path) -> Result<()>;

    /// Gives a file a second name.
    fn link(&self, path: &Path, second: &Path) -> Result<()>;

    /// Removes a file.
    fn remove(&self, path: &Path) -> Result<()>;

    /// Removes a folder with all that is in it.
    fn remove_folder(&self, path: &Path) -> Result<()>;

    /// Makes new, renamed and removed entries of a folder durable.
    fn sync_folder(&self, path: &Path) -> Result<()>;
}

/// A file that is being written.
pub(super) trait DiskFile: Write + Seek + Send {
    /// The same file with the same position.
    fn another(&self) -> Result<Box<dyn DiskFile>>;

    /// Makes the file so long.
    fn set_len(&self, bytes: u64) -> Result<()>;

    /// Makes data and length durable.
    fn sync(&self) -> Result<()>;
}

/// The disk of the machine.
pub(super) struct RealDisk;

impl Disk for RealDisk {
    fn create(&self, path: &Path) -> Result<Box<dyn DiskFile>> {
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(path)?;
        Ok(Box::new(file))
    }

    fn create_folder(&self, path: &Path) -> Result<()> {
        std::fs::create_dir_all(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        std::fs::rename(from, to)
    }

    fn link(&self, path: &Path, second: &Path) -> Result<()> {
        std::fs::hard_link(path, second)
    }

    fn remove(&self, path: &Path) -> Result<()> {
        std::fs::remove_file(path)
    }

    fn remove_folder(&self, path: &Path) -> Result<()> {
        std::fs::remove_dir_all(path)
    }

    fn sync_folder(&self, path: &Path) -> Result<()> {
        std::fs::File::open(path)?.sync_all()
    }
}

impl DiskFile for std::fs::File {
    fn another(&self) -> Result<Box<dyn DiskFile>> {
        Ok(Box::new(self.try_clone()?))
    }

    fn set_len(&self, bytes: u64) -> Result<()> {
        Self::set_len(self, bytes)
    }

    fn sync(&self) -> Result<()> {
        self.sync_data()
    }
}
