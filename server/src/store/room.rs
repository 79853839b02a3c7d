//! How much room recordings have: quotas, and the space that is left on the disk.
//!
//! The disk is asked, at most once a second. In between, what is written is added to what was seen.

use super::config::RecordingConfig;
use super::directory::{BEING_WRITTEN, maps_in};
use super::error::StoreError;
use std::collections::BTreeMap;
use std::fs::DirEntry;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a look at the disk is believed.
const BELIEVED: Duration = Duration::from_secs(1);

/// What is used and what is left, bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Usage {
    /// Of each map.
    pub maps: BTreeMap<String, u64>,
    /// Free on the disk.
    pub free: u64,
}

impl Usage {
    /// Of all maps.
    pub(crate) fn total(&self) -> u64 {
        self.maps.values().sum()
    }

    fn of(directory: &Path) -> std::io::Result<Self> {
        let folders =
            maps_in(directory).map_err(|error| std::io::Error::other(error.to_string()))?;
        let maps = folders.into_iter().map(|(name, folder)| Ok((name, bytes_in(&folder)?)));
        let disk = rustix::fs::statvfs(directory)?;
        Ok(Self {
            maps: maps.collect::<std::io::Result<_>>()?,
            free: disk.f_bavail.saturating_mul(disk.f_frsize),
        })
    }
}

/// Bytes of the files in a folder. Files that vanish meanwhile do not count, nor does a checkpoint that is
/// being written: its [`Reservation`] does.
fn bytes_in(folder: &Path) -> std::io::Result<u64> {
    let is_finished = |entry: &DirEntry| {
        !entry.file_name().to_str().is_some_and(|name| name.ends_with(BEING_WRITTEN))
    };
    let entries = std::fs::read_dir(folder)?.filter_map(Result::ok).filter(is_finished);
    Ok(entries.filter_map(|entry| Some(entry.metadata().ok()?.len())).sum())
}

/// Watches the room of a data directory.
pub(super) struct Room {
    directory: PathBuf,
    limits: RecordingConfig,
    used: Mutex<Used>,
    /// Why frames of a map cannot be recorded at present, by its name.
    failing: Mutex<BTreeMap<String, String>>,
    /// Why no checkpoint of a map can be written at present, by its name.
    unsaved: Mutex<BTreeMap<String, String>>,
}

/// What is known of the bytes in the directory.
#[derive(Default)]
struct Used {
    /// The newest look at the disk, with the frames that were admitted since.
    seen: Option<(Instant, Usage)>,
    /// Bytes of each map that are being written beside its finished files.
    reserved: BTreeMap<String, u64>,
}

impl Room {
    pub(super) fn new(directory: &Path, limits: RecordingConfig) -> Self {
        let used = Mutex::default();
        let (failing, unsaved) = (Mutex::default(), Mutex::default());
        Self { directory: directory.to_owned(), limits, used, failing, unsaved }
    }

    /// What is used and what is left.
    ///
    /// # Errors
    /// [`StoreError::Io`] if the disk cannot be asked.
    pub(super) fn usage(&self) -> Result<Usage, StoreError> {
        let mut used = locked(&self.used);
        let mut usage = self.look(&mut used)?.clone();
        for (map, bytes) in &used.reserved {
            *usage.maps.entry(map.clone()).or_default() += bytes;
        }
        Ok(usage)
    }

    /// What the disk had at the newest look, which is a second old at most.
    fn look<'a>(&self, used: &'a mut Used) -> Result<&'a mut Usage, StoreError> {
        let seen = used.seen.take().filter(|(when, _)| when.elapsed() < BELIEVED);
        let seen = match seen {
            Some(seen) => seen,
            None => {
                let usage = Usage::of(&self.directory)
                    .map_err(|reason| StoreError::io("measure", &self.directory, reason))?;
                (Instant::now(), usage)
            }
        };
        Ok(&mut used.seen.insert(seen).1)
    }

    /// Checks that a map may have so many bytes more, where so many will be removed.
    ///
    /// # Errors
    /// [`StoreError::Quota`], [`StoreError::Io`].
    fn check(
        &self,
        used: &mut Used,
        map: &str,
        wanted: u64,
        removed: u64,
    ) -> Result<(), StoreError> {
        let RecordingConfig { max_bytes, max_map_bytes, .. } = self.limits;
        let usage = self.look(used)?;
        let (of_map, of_all) = (usage.maps.get(map).copied().unwrap_or_default(), usage.total());
        let reserved = used.reserved.get(map).copied().unwrap_or_default();
        let full = |key, used: u64, most: u64| {
            let used = used.saturating_sub(removed);
            (most > 0 && used.saturating_add(wanted) > most).then_some(StoreError::Quota {
                key,
                used,
                wanted,
                most,
            })
        };
        let full =
            full("recording.max_map_bytes", of_map + reserved, max_map_bytes).or_else(|| {
                full("recording.max_bytes", of_all + used.reserved.values().sum::<u64>(), max_bytes)
            });
        full.map_or(Ok(()), Err)
    }

    /// Checks that a frame of so many bytes can be added to a map, and counts it.
    ///
    /// # Errors
    /// [`StoreError::Quota`], [`StoreError::Io`].
    pub(super) fn admit(&self, map: &str, bytes: u64) -> Result<(), StoreError> {
        if !self.is_limited() {
            return Ok(());
        }
        let mut used = locked(&self.used);
        self.check(&mut used, map, bytes, 0)?;
        *self.look(&mut used)?.maps.entry(map.to_owned()).or_default() += bytes;
        Ok(())
    }

    /// Room for files of a map that are being written; it grows with them.
    pub(super) fn reserve(&self, map: &str) -> Reservation<'_> {
        Reservation { room: self, map: map.to_owned(), bytes: 0, replaced: 0, spare: 0 }
    }

    /// Room for a checkpoint in the place of older ones of so many bytes. It may take half of what is left,
    /// so that frames still have room.
    pub(super) fn reserve_checkpoint(&self, map: &str, replaced: u64) -> Reservation<'_> {
        Reservation { room: self, map: map.to_owned(), bytes: 0, replaced, spare: 1 }
    }

    fn is_limited(&self) -> bool {
        self.limits.max_bytes > 0 || self.limits.max_map_bytes > 0
    }

    /// Notes how recording a frame of a map went.
    pub(super) fn note(&self, map: &str, recorded: &Result<(), StoreError>) {
        note(&self.failing, map, recorded.as_ref().err());
    }

    /// Notes how writing a checkpoint of a map went.
    pub(super) fn note_checkpoint<T>(&self, map: &str, written: &Result<T, StoreError>) {
        note(&self.unsaved, map, written.as_ref().err());
    }

    /// Forgets a map that was deleted.
    pub(super) fn forget(&self, map: &str) {
        note(&self.failing, map, None);
        note(&self.unsaved, map, None);
        locked(&self.used).seen = None;
    }

    /// What is wrong or soon will be, in words.
    pub(super) fn warnings(&self) -> Vec<String> {
        let failing = locked(&self.failing).clone().into_iter();
        let failing =
            failing.map(|(map, reason)| format!("{map}: frames cannot be recorded: {reason}"));
        let unsaved = locked(&self.unsaved).clone().into_iter();
        let unsaved = unsaved.map(|(map, reason)| {
            format!(
                "{map}: no checkpoint is written, so a restart maps its newer frames again: {reason}"
            )
        });
        let low = self.usage().ok().and_then(|usage| self.low(&usage));
        failing.chain(unsaved).chain(low).collect()
    }

    fn low(&self, usage: &Usage) -> Option<String> {
        let RecordingConfig { max_bytes, low_bytes, .. } = self.limits;
        let of_quota = (max_bytes > 0).then(|| max_bytes.saturating_sub(usage.total()));
        let (left, of) = match of_quota {
            Some(left) if left < usage.free => (left, "of recording.max_bytes"),
            _ => (usage.free, "on the disk of the data directory"),
        };
        let mib = left >> 20;
        (left < low_bytes).then(|| {
            format!("{mib} MiB are left {of}: make room, or delete maps, before frames are refused")
        })
    }
}

/// Room that files take while they are written. When it is dropped, the disk is looked at again.
pub(super) struct Reservation<'a> {
    room: &'a Room,
    map: String,
    bytes: u64,
    /// Bytes of files that are removed in the end.
    replaced: u64,
    /// How many times the reserved bytes have to be left.
    spare: u64,
}

impl Reservation<'_> {
    /// Takes so many bytes more.
    ///
    /// # Errors
    /// [`StoreError::Quota`], [`StoreError::Io`].
    pub(super) fn grow(&mut self, bytes: u64) -> Result<(), StoreError> {
        if !self.room.is_limited() {
            return Ok(());
        }
        let grown = self.bytes.saturating_add(bytes);
        let wanted = bytes.saturating_add(grown.saturating_mul(self.spare));
        let mut used = locked(&self.room.used);
        self.room.check(&mut used, &self.map, wanted, self.replaced)?;
        *used.reserved.entry(self.map.clone()).or_default() += bytes;
        self.bytes = grown;
        Ok(())
    }
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        let mut used = locked(&self.room.used);
        used.seen = None;
        if let Some(reserved) = used.reserved.get_mut(&self.map) {
            *reserved -= self.bytes;
        }
        used.reserved.retain(|_, bytes| *bytes > 0);
    }
}

fn note(reasons: &Mutex<BTreeMap<String, String>>, map: &str, error: Option<&StoreError>) {
    let mut reasons = locked(reasons);
    match error {
        None => drop(reasons.remove(map)),
        Some(error) => drop(reasons.insert(map.to_owned(), error.reason())),
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(directory: &Path, limits: RecordingConfig) -> Room {
        for (map, bytes) in [("kitchen", 600), ("hall", 300)] {
            let folder = directory.join(format!("{map}.map"));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("0001.mcap"), vec![0; bytes]).unwrap();
        }
        // Of another program.
        std::fs::write(directory.join("access.log"), vec![0; 5000]).unwrap();
        Room::new(directory, limits)
    }

    #[test]
    fn quotas_hold_for_a_map_and_for_all() {
        let folder = tempfile::tempdir().unwrap();
        let limits = |max_bytes, max_map_bytes| {
            let limits = RecordingConfig { max_bytes, max_map_bytes, low_bytes: 0 };
            room(folder.path(), limits)
        };
        let unlimited = limits(0, 0);
        assert_eq!(unlimited.usage().unwrap().total(), 900);
        assert!(unlimited.admit("kitchen", 999).is_ok());
        let of_map = limits(0, 500);
        let refused = of_map.admit("kitchen", 1).unwrap_err().to_string();
        assert!(refused.contains("recording.max_map_bytes"), "{refused}");
        assert!(of_map.admit("hall", 200).is_ok() && of_map.admit("new", 500).is_ok());
        assert!(of_map.admit("hall", 1).is_err(), "what was admitted counts at once");
        let of_all = limits(900, 700);
        let refused = of_all.admit("new", 1).unwrap_err().to_string();
        assert!(refused.contains("recording.max_bytes"), "{refused}");
        assert!(limits(901, 700).admit("new", 1).is_ok());
    }

    #[test]
    fn what_is_being_written_counts_until_it_is_there_or_given_up() {
        let folder = tempfile::tempdir().unwrap();
        let limits = RecordingConfig { max_bytes: 1000, max_map_bytes: 0, low_bytes: 0 };
        let room = room(folder.path(), limits);
        let mut restore = room.reserve("new");
        restore.grow(60).unwrap();
        assert_eq!(room.usage().unwrap().maps["new"], 60);
        assert!(restore.grow(41).is_err());
        let mut other = room.reserve("other");
        assert!(other.grow(41).is_err(), "of another restore");
        assert!(room.admit("kitchen", 41).is_err(), "of a frame");
        drop(restore);
        assert_eq!(room.usage().unwrap().total(), 900);
        other.grow(41).unwrap();
        room.admit("kitchen", 41).unwrap();
    }

    #[test]
    fn a_checkpoint_leaves_room_for_frames() {
        let folder = tempfile::tempdir().unwrap();
        let limits = RecordingConfig { max_bytes: 1000, max_map_bytes: 0, low_bytes: 0 };
        let room = room(folder.path(), limits);
        assert!(room.reserve_checkpoint("kitchen", 0).grow(51).is_err());
        let mut first = room.reserve_checkpoint("kitchen", 0);
        first.grow(30).unwrap();
        first.grow(20).unwrap();
        assert!(first.grow(1).is_err(), "more than half of what was left");
        room.admit("kitchen", 50).unwrap();
        drop(first);
        // The older one of 50 bytes is removed in the end.
        std::fs::write(folder.path().join("kitchen.map/checkpoint-0001.lexsplat"), [0; 50])
            .unwrap();
        let mut next = room.reserve_checkpoint("kitchen", 50);
        next.grow(50).unwrap();
        assert!(next.grow(1).is_err());
        let writing = folder.path().join("kitchen.map/checkpoint-0002.lexsplat.unfinished");
        std::fs::write(writing, [0; 50]).unwrap();
        drop(next);
        let mut next = room.reserve_checkpoint("kitchen", 50);
        next.grow(50).unwrap();
        assert_eq!(room.usage().unwrap().total(), 1000, "the file is not counted twice");
    }

    #[test]
    fn what_is_wrong_is_told_until_it_is_well_again() {
        let folder = tempfile::tempdir().unwrap();
        let room = room(folder.path(), RecordingConfig { low_bytes: 0, ..Default::default() });
        assert!(room.warnings().is_empty());
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        room.note("kitchen", &Err(StoreError::io("write", folder.path(), full)));
        let warnings = room.warnings();
        assert!(warnings[0].starts_with("kitchen: frames cannot be recorded"), "{warnings:?}");
        room.note("hall", &Ok(()));
        assert_eq!(room.warnings(), warnings);
        room.note("kitchen", &Ok(()));
        assert!(room.warnings().is_empty());
    }

    #[test]
    fn little_room_is_told_before_there_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let warnings = |max_bytes, low_bytes| {
            let limits = RecordingConfig { max_bytes, max_map_bytes: 0, low_bytes };
            room(folder.path(), limits).warnings()
        };
        assert!(warnings(1000, 50).is_empty());
        let low = warnings(1000, 200);
        assert!(low[0].contains("recording.max_bytes"), "{low:?}");
        let disk = warnings(0, u64::MAX);
        assert!(disk[0].contains("disk"), "{disk:?}");
    }
}
