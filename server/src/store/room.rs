//! How much room recordings have: quotas, and the space that is left on the disk.
//!
//! The disk is asked, at most once a second. So a quota can be exceeded by the frames of a second.

use super::directory::maps_in;
use super::error::StoreError;
use crate::pipeline::range::OutOfRange;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a look at the disk is believed.
const BELIEVED: Duration = Duration::from_secs(1);

/// Limits on the data directory, section `recording`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingConfig {
    /// Bytes that all maps may have in the data directory; 0: no limit.
    pub max_bytes: u64,
    /// Bytes that one map may have there; 0: no limit.
    pub max_map_bytes: u64,
    /// Below this many free bytes, on the disk or below `max_bytes`, the server warns.
    pub low_bytes: u64,
}

impl Default for RecordingConfig {
    fn default() -> Self {
        Self { max_bytes: 0, max_map_bytes: 0, low_bytes: 1 << 30 }
    }
}

impl RecordingConfig {
    /// Checks that the limits fit together.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        let Self { max_bytes, max_map_bytes, .. } = *self;
        crate::pipeline::range::require(
            max_bytes == 0 || max_map_bytes <= max_bytes,
            "recording.max_map_bytes",
            max_map_bytes,
            format!("at most recording.max_bytes, which is {max_bytes}"),
        )
    }
}

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

/// Bytes of the files in a folder. Files that vanish meanwhile do not count.
fn bytes_in(folder: &Path) -> std::io::Result<u64> {
    let entries = std::fs::read_dir(folder)?;
    Ok(entries.filter_map(|entry| Some(entry.ok()?.metadata().ok()?.len())).sum())
}

/// Watches the room of a data directory.
pub(super) struct Room {
    directory: PathBuf,
    limits: RecordingConfig,
    seen: Mutex<Option<(Instant, Usage)>>,
    /// Why frames of a map cannot be recorded at present, by its name.
    failing: Mutex<BTreeMap<String, String>>,
}

impl Room {
    pub(super) fn new(directory: &Path, limits: RecordingConfig) -> Self {
        let (seen, failing) = (Mutex::default(), Mutex::default());
        Self { directory: directory.to_owned(), limits, seen, failing }
    }

    /// What is used and what is left.
    ///
    /// # Errors
    /// [`StoreError::Io`] if the disk cannot be asked.
    pub(super) fn usage(&self) -> Result<Usage, StoreError> {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((when, usage)) = &*seen
            && when.elapsed() < BELIEVED
        {
            return Ok(usage.clone());
        }
        let usage = Usage::of(&self.directory)
            .map_err(|reason| StoreError::io("measure", &self.directory, reason))?;
        *seen = Some((Instant::now(), usage.clone()));
        Ok(usage)
    }

    /// Checks that a map may have more.
    ///
    /// # Errors
    /// [`StoreError::Quota`], [`StoreError::Io`].
    pub(super) fn admit(&self, map: &str) -> Result<(), StoreError> {
        let RecordingConfig { max_bytes, max_map_bytes, .. } = self.limits;
        if max_bytes == 0 && max_map_bytes == 0 {
            return Ok(());
        }
        let usage = self.usage()?;
        let of_map = usage.maps.get(map).copied().unwrap_or_default();
        let full = |key, used: u64, most: u64| {
            (most > 0 && used >= most).then_some(StoreError::Quota { key, used, most })
        };
        let full = full("recording.max_map_bytes", of_map, max_map_bytes)
            .or_else(|| full("recording.max_bytes", usage.total(), max_bytes));
        full.map_or(Ok(()), Err)
    }

    /// Notes how recording a frame of a map went.
    pub(super) fn note(&self, map: &str, recorded: &Result<(), StoreError>) {
        let mut failing = self.failing();
        match recorded {
            Ok(()) => drop(failing.remove(map)),
            Err(error) => drop(failing.insert(map.to_owned(), error.reason())),
        }
    }

    /// Forgets a map that was deleted.
    pub(super) fn forget(&self, map: &str) {
        self.failing().remove(map);
        *self.seen.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// What is wrong or soon will be, in words.
    pub(super) fn warnings(&self) -> Vec<String> {
        let failing = self.failing().clone().into_iter();
        let failing =
            failing.map(|(map, reason)| format!("{map}: frames cannot be recorded: {reason}"));
        let low = self.usage().ok().and_then(|usage| self.low(&usage));
        failing.chain(low).collect()
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

    fn failing(&self) -> MutexGuard<'_, BTreeMap<String, String>> {
        self.failing.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

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
        assert!(unlimited.admit("kitchen").is_ok() && unlimited.admit("new").is_ok());
        let of_map = limits(0, 500);
        let refused = of_map.admit("kitchen").unwrap_err().to_string();
        assert!(refused.contains("recording.max_map_bytes"), "{refused}");
        assert!(of_map.admit("hall").is_ok() && of_map.admit("new").is_ok());
        let of_all = limits(900, 700);
        let refused = of_all.admit("new").unwrap_err().to_string();
        assert!(refused.contains("recording.max_bytes"), "{refused}");
        assert!(limits(901, 700).admit("new").is_ok());
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

    #[test]
    fn limits_are_checked() {
        assert_checks(
            "recording",
            RecordingConfig::check,
            &[(
                "recording.max_map_bytes",
                |c| (c.max_bytes, c.max_map_bytes) = (10, 11),
                |c| (c.max_bytes, c.max_map_bytes) = (10, 10),
            )],
            &["recording.max_bytes", "recording.low_bytes"],
        );
    }
}
