//! The data directory: its lock, and the folders of the maps in it.
//!
//! ```text
//! DATA/lexsplat.lock          held by the one server that uses the directory
//! DATA/kitchen.map/0001.mcap  the recording of the map "kitchen"; a new file for each stream
//! ```
//!
//! Nothing else in the directory is read or changed. A map is deleted by renaming its folder, which happens
//! as a whole or not at all; what is left of it is removed then, or at the next start.

use super::disk::Disk;
use super::error::StoreError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

const LOCK: &str = "lexsplat.lock";
/// Ending of a map's folder.
const MAP: &str = ".map";
/// Ending of the folder of a map that was deleted.
const DELETED: &str = ".map.deleted";
/// Ending of what is being written: a checkpoint, or the folder of a backup that is being put in place.
pub(super) const BEING_WRITTEN: &str = ".unfinished";

/// A data directory that this server alone uses, until it is dropped or the process ends.
pub(super) struct Directory {
    disk: Arc<dyn Disk>,
    path: PathBuf,
    _lock: File,
}

impl Directory {
    /// Locks a directory, which is created if needed, and removes what is left of deleted maps.
    ///
    /// # Errors
    /// [`StoreError::InUse`] if another server has it, [`StoreError::Io`].
    pub(super) fn open(disk: Arc<dyn Disk>, path: &Path) -> Result<Self, StoreError> {
        let io = |action| move |reason| StoreError::io(action, path, reason);
        std::fs::create_dir_all(path).map_err(io("create the data directory"))?;
        let lock = locked(path)?;
        let directory = Self { disk, path: path.to_owned(), _lock: lock };
        let unfinished = folders(path, &format!("{MAP}{BEING_WRITTEN}"))?;
        for (_, folder) in folders(path, DELETED)?.into_iter().chain(unfinished) {
            directory.disk.remove_folder(&folder).map_err(io("remove a deleted map from"))?;
        }
        Ok(directory)
    }

    /// The names of all maps that have a folder, sorted.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn maps(&self) -> Result<Vec<String>, StoreError> {
        Ok(maps_in(&self.path)?.into_iter().map(|(name, _)| name).collect())
    }

    /// What changes the directory.
    pub(super) fn disk(&self) -> &Arc<dyn Disk> {
        &self.disk
    }

    /// The folder of a map that is not complete yet.
    pub(super) fn unfinished(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}{MAP}{BEING_WRITTEN}"))
    }

    /// A new folder that belongs to no map.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn temporary(&self) -> std::io::Result<TempDir> {
        // No map is called so, because of the dot.
        let ending = format!("{MAP}{BEING_WRITTEN}");
        tempfile::Builder::new().prefix(".temporary-").suffix(&ending).tempdir_in(&self.path)
    }

    /// Makes an unfinished folder, whose files are on disk, the folder of a map, which must have none.
    ///
    /// # Errors
    /// [`StoreError::Io`]; then the unfinished folder is gone.
    pub(super) fn finish(&self, name: &str) -> Result<(), StoreError> {
        let (unfinished, folder) = (self.unfinished(name), self.map(name));
        // Renaming onto a folder with files is an error.
        let renamed =
            self.disk.rename(&unfinished, &folder).and_then(|()| self.disk.sync_folder(&self.path));
        renamed.map_err(|reason| {
            // What is left is removed at the next start.
            let _ = self.disk.remove_folder(&unfinished);
            StoreError::io("create", &folder, reason)
        })
    }

    /// The folder of a map. Names of maps have no path separators.
    pub(super) fn map(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}{MAP}"))
    }

    /// Makes the folder of a map, if there is none.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn make(&self, name: &str) -> Result<(), StoreError> {
        let folder = self.map(name);
        let made =
            self.disk.create_folder(&folder).and_then(|()| self.disk.sync_folder(&self.path));
        made.map_err(|reason| StoreError::io("create", &folder, reason))
    }

    /// Renames the folder of a map; none may have the new name.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn rename(&self, name: &str, to: &str) -> Result<(), StoreError> {
        let (from, to) = (self.map(name), self.map(to));
        let renamed = self.disk.rename(&from, &to).and_then(|()| self.disk.sync_folder(&self.path));
        renamed.map_err(|reason| StoreError::io("rename", &from, reason))
    }

    /// Removes the folder of a map, if there is one.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn remove(&self, name: &str) -> Result<(), StoreError> {
        let (folder, deleted) = (self.map(name), self.path.join(format!("{name}{DELETED}")));
        if !folder.exists() {
            return Ok(());
        }
        let removed = self
            .disk
            .rename(&folder, &deleted)
            .and_then(|()| self.disk.sync_folder(&self.path))
            .and_then(|()| self.disk.remove_folder(&deleted));
        removed.map_err(|reason| StoreError::io("remove", &folder, reason))
    }
}

/// The names and folders of all maps in a data directory, sorted. Needs no lock.
///
/// # Errors
/// [`StoreError::Io`].
pub(super) fn maps_in(directory: &Path) -> Result<Vec<(String, PathBuf)>, StoreError> {
    folders(directory, MAP)
}

/// All folders with this ending, with their stems, sorted.
fn folders(directory: &Path, ending: &str) -> Result<Vec<(String, PathBuf)>, StoreError> {
    let failed = |reason| StoreError::io("list", directory, reason);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name();
        let stem = name.to_str().and_then(|name| name.strip_suffix(ending));
        if let Some(stem) = stem.filter(|stem| !stem.is_empty())
            && entry.path().is_dir()
        {
            found.push((stem.to_owned(), entry.path()));
        }
    }
    found.sort();
    Ok(found)
}

/// Takes the lock of a directory and writes into it who has it.
fn locked(directory: &Path) -> Result<File, StoreError> {
    let path = directory.join(LOCK);
    let io = |reason| StoreError::io("lock", &path, reason);
    let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
    let mut file = open.map_err(io)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut owner = String::new();
            file.read_to_string(&mut owner).map_err(io)?;
            let owner = owner.trim().to_owned();
            return Err(StoreError::InUse { path: directory.to_owned(), owner });
        }
        Err(TryLockError::Error(reason)) => return Err(io(reason)),
    }
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let written = file
        .set_len(0)
        .and_then(|()| file.rewind())
        .and_then(|()| writeln!(file, "process {} on {}", std::process::id(), host.trim()));
    written.map_err(io)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::super::disk::RealDisk;
    use super::*;

    fn open(path: &Path) -> Result<Directory, StoreError> {
        Directory::open(Arc::new(RealDisk), path)
    }

    #[test]
    fn a_directory_has_one_owner() {
        let folder = tempfile::tempdir().unwrap();
        let first = open(folder.path()).unwrap();
        let second = open(folder.path()).map(|_| ()).unwrap_err().to_string();
        let owner = format!("process {}", std::process::id());
        assert!(second.contains(&owner) && second.contains("another server"), "{second}");
        drop(first);
        assert!(open(folder.path()).is_ok(), "it is free again");
    }

    #[test]
    fn foreign_files_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("access.log"), "GET /").unwrap();
        std::fs::write(path("notes.map"), "a file, not a folder").unwrap();
        std::fs::create_dir(path("kitchen.map")).unwrap();
        std::fs::create_dir(path("photos")).unwrap();
        let directory = open(folder.path()).unwrap();
        assert_eq!(directory.maps().unwrap(), ["kitchen"]);
        directory.remove("kitchen").unwrap();
        directory.remove("kitchen").unwrap();
        assert!(directory.maps().unwrap().is_empty() && !path("kitchen.map").exists());
        assert_eq!(std::fs::read_to_string(path("access.log")).unwrap(), "GET /");
        assert!(path("photos").exists() && path("notes.map").exists());
    }

    #[test]
    fn a_map_that_was_half_removed_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("kitchen.map.deleted")).unwrap();
        let directory = open(folder.path()).unwrap();
        assert!(directory.maps().unwrap().is_empty());
        assert!(!folder.path().join("kitchen.map.deleted").exists());
    }
}
