//! Recordings of accepted frames, so that maps survive a crash or a restart of the server.
//!
//! In: opening messages and accepted frames, as they came over the wire. Out: [MCAP](https://mcap.dev) files,
//! which robotics tools open, in a folder for each map in the data directory. Without a data directory
//! nothing is recorded.
//!
//! Beside the recording there is a checkpoint: the state of the map after one of the frames.
//!
//! Each frame is a chunk with a checksum, and on disk before it is mapped or acknowledged. What a crash left
//! of a frame is cut off. Any other damage is reported, what is whole is used, and the file is set aside.

mod backup;
mod checkpoints;
mod config;
mod directory;
mod disk;
mod error;
mod examine;
mod messages;
mod reader;
mod recording;
mod room;
mod writer;

pub(crate) use backup::{Backup, BackupFault, Unpacked};
pub(crate) use checkpoints::{
    CheckpointFault, CheckpointReader, Label, encode as encode_checkpoint,
};
pub use config::RecordingConfig;
pub(crate) use error::StoreError;
pub(crate) use examine::{MapReport, examine};
pub(crate) use reader::{Damage, Entry};
pub(crate) use recording::{Recorder, Records};
pub(crate) use room::Usage;

use directory::Directory;
use disk::{Disk, RealDisk};
use lexsplat_proto::v1;
use recording::Life;
use room::Room;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use tempfile::TempDir;

/// The data directory with the recordings. Cheap to clone.
#[derive(Clone, Default)]
pub(crate) struct Store {
    /// `None`: nothing is recorded.
    directory: Option<Arc<Directory>>,
    /// As for the directory.
    room: Option<Arc<Room>>,
    /// Of maps with a recorder.
    lives: Arc<Mutex<BTreeMap<String, Life>>>,
}

impl Store {
    /// A store in `directory`, which is created if needed; with `None` nothing is recorded.
    ///
    /// # Errors
    /// [`StoreError::InUse`] if another server uses it, [`StoreError::Io`].
    pub(crate) fn open(
        directory: Option<&Path>,
        limits: &RecordingConfig,
    ) -> Result<Self, StoreError> {
        Self::on(Arc::new(RealDisk), directory, limits)
    }

    fn on(
        disk: Arc<dyn Disk>,
        directory: Option<&Path>,
        limits: &RecordingConfig,
    ) -> Result<Self, StoreError> {
        let room = directory.map(|path| Arc::new(Room::new(path, limits.clone())));
        let directory = directory.map(|path| Directory::open(disk, path)).transpose()?;
        Ok(Self { directory: directory.map(Arc::new), room, lives: Arc::default() })
    }

    /// What the maps use of the disk, and what is free; `None` if nothing is recorded.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn usage(&self) -> Result<Option<Usage>, StoreError> {
        self.room.as_ref().map(|room| room.usage()).transpose()
    }

    /// What is wrong with recording, or soon will be, in words.
    pub(crate) fn warnings(&self) -> Vec<String> {
        self.room.as_ref().map(|room| room.warnings()).unwrap_or_default()
    }

    /// A recorder for the map that `open` names; `None` if nothing is recorded.
    ///
    /// Only the map's one sender may call this.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) async fn record(&self, open: &v1::OpenMap) -> Result<Option<Recorder>, StoreError> {
        let (Some(directory), Some(room)) = (&self.directory, self.room.clone()) else {
            return Ok(None);
        };
        let (disk, folder) = (directory.disk().clone(), directory.map(&open.map));
        let open = open.clone();
        let lives = self.lives.clone();
        let made = tokio::task::spawn_blocking(move || {
            // A deletion in progress comes first.
            let mut lives = lives.lock().unwrap_or_else(PoisonError::into_inner);
            let life = lives.entry(open.map.clone()).or_default().clone();
            Recorder::new(disk, folder, open, room, life)
        });
        made.await.expect("making a folder does not panic").map(Some)
    }

    /// Makes the folder of a map without frames, so that the map is there after a restart.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) async fn keep(&self, map: &str) -> Result<(), StoreError> {
        let Some(directory) = self.directory.clone() else { return Ok(()) };
        let map = map.to_owned();
        let made = tokio::task::spawn_blocking(move || directory.make(&map));
        made.await.expect("making a folder does not panic")
    }

    /// Removes the map's recording, if there is one.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) async fn forget(&self, map: &str) -> Result<(), StoreError> {
        let Some(directory) = self.directory.clone() else { return Ok(()) };
        let map = map.to_owned();
        let (room, lives) = (self.room.clone(), self.lives.clone());
        let removed = tokio::task::spawn_blocking(move || {
            let mut lives = lives.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(life) = lives.remove(&map) {
                // Streams of the map that are still open write nothing any more.
                *life.write().unwrap_or_else(PoisonError::into_inner) = true;
            }
            directory.remove(&map)?;
            room.iter().for_each(|room| room.forget(&map));
            Ok(())
        });
        removed.await.expect("removing a folder does not panic")
    }

    /// Renames the folder of a map, as a whole or not at all. No map may have the new name, and nobody may
    /// send frames to this one.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) async fn rename(&self, map: &str, to: &str) -> Result<(), StoreError> {
        let Some(directory) = self.directory.clone() else { return Ok(()) };
        let (map, to) = (map.to_owned(), to.to_owned());
        let (room, lives) = (self.room.clone(), self.lives.clone());
        let renamed = tokio::task::spawn_blocking(move || {
            lives.lock().unwrap_or_else(PoisonError::into_inner).remove(&map);
            directory.rename(&map, &to)?;
            room.iter().for_each(|room| room.forget(&map));
            Ok(())
        });
        renamed.await.expect("renaming a folder does not panic")
    }

    /// The names of all maps with a recording, sorted.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn maps(&self) -> Result<Vec<String>, StoreError> {
        self.directory.as_ref().map_or(Ok(Vec::new()), |directory| directory.maps())
    }

    /// A new folder for files that are needed for a while. Its end removes it, or the next start. It is on
    /// the disk of the data directory, if there is one.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn temporary_folder(&self) -> std::io::Result<TempDir> {
        match &self.directory {
            Some(directory) => directory.temporary(),
            None => tempfile::Builder::new().prefix("lexsplat-").tempdir(),
        }
    }

    /// Whether frames are recorded.
    pub(crate) fn is_recording(&self) -> bool {
        self.directory.is_some()
    }

    /// Whether there is a folder for the map.
    pub(crate) fn has(&self, map: &str) -> bool {
        self.directory.as_ref().is_some_and(|directory| directory.map(map).is_dir())
    }

    /// Reads a map's recording.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn records(&self, map: &str) -> Result<Records, StoreError> {
        let Some(directory) = &self.directory else { return Ok(Records::none()) };
        Records::open(directory.disk().clone(), directory.map(map))
    }

    /// Writes a checkpoint of a map and removes older ones. Returns its bytes; `None` if nothing is recorded.
    ///
    /// # Errors
    /// [`StoreError::Io`], [`StoreError::Quota`]; then the older checkpoints are as they were.
    pub(crate) fn save(
        &self,
        label: &Label,
        write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<Option<u64>, StoreError> {
        let (Some(directory), Some(room)) = (&self.directory, &self.room) else { return Ok(None) };
        let folder = directory.map(&label.map);
        let written = checkpoints::write(&**directory.disk(), &folder, room, label, write);
        room.note_checkpoint(&label.map, &written);
        written.map(Some)
    }

    /// The checkpoints of a map, newest first.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn checkpoints(&self, map: &str) -> Result<Vec<PathBuf>, StoreError> {
        let Some(directory) = &self.directory else { return Ok(Vec::new()) };
        let folder = directory.map(map);
        if folder.is_dir() { checkpoints::list(&folder) } else { Ok(Vec::new()) }
    }

    /// Opens the files of a map for a backup; `None` if the map has none.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn backup(&self, map: &str) -> Result<Option<Backup>, StoreError> {
        let Some(directory) = self.directory.as_ref().filter(|_| self.has(map)) else {
            return Ok(None);
        };
        let backup = Backup::open(&directory.map(map))?;
        Ok(Some(backup).filter(|backup| !backup.is_empty()))
    }

    /// Unpacks a backup, checks it, and makes it the folder of a map that has none; as a whole or not at
    /// all. Returns `None` if nothing is recorded here.
    ///
    /// # Errors
    /// [`BackupFault`].
    pub(crate) fn restore(
        &self,
        map: &str,
        tar: impl Read,
    ) -> Result<Option<Unpacked>, BackupFault> {
        let (Some(directory), Some(room)) = (&self.directory, &self.room) else { return Ok(None) };
        let (disk, folder) = (&**directory.disk(), directory.unfinished(map));
        let mut reserved = room.reserve(map);
        let unpacked = backup::unpack(disk, &folder, &mut reserved, tar)?;
        // Until then the files count as reserved.
        directory.finish(map)?;
        Ok(Some(unpacked))
    }

    /// Files of a map's recording that were damaged and set aside.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn damaged(&self, map: &str) -> Result<Vec<PathBuf>, StoreError> {
        let Some(directory) = &self.directory else { return Ok(Vec::new()) };
        let folder = directory.map(map);
        if folder.is_dir() { recording::damaged(&folder) } else { Ok(Vec::new()) }
    }
}

#[cfg(test)]
mod backup_tests;
#[cfg(test)]
mod crash_model;
#[cfg(test)]
mod crash_tests;
#[cfg(test)]
mod faulty_disk;
#[cfg(test)]
mod mutation_tests;
#[cfg(test)]
mod tests;
