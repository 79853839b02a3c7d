//! Backups of maps: taken while frames are mapped, and put in place under a free name.

use super::error::MapsError;
use super::recorded::RecordedMaps;
use super::save;
use crate::pipeline::engine::check_name;
use crate::pipeline::map::MapError;
use crate::store::{Backup, BackupFault, Unpacked};
use std::io::Read;
use tokio::sync::OwnedSemaphorePermit;

/// Why there is no backup, or one cannot be put in place.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BackupError {
    #[error(transparent)]
    Maps(#[from] MapsError),
    #[error("nothing is recorded: the server has no data directory (--data-dir)")]
    NotRecorded,
    #[error("map {name:?} has no recorded frame")]
    Empty { name: String },
    #[error("as many backups as the server handles at a time are under way: try again later")]
    Busy,
    #[error("{reason}: send it faster")]
    Slow { reason: String },
    /// The message names the file in the archive.
    #[error("{reason}")]
    Refused { reason: String },
}

/// Writes a checkpoint of a map and opens its files. A map that is not loaded is backed up as it is on
/// disk. The permit is to be kept until the backup is written.
///
/// # Errors
/// [`BackupError`].
pub(crate) async fn backup(
    maps: &RecordedMaps,
    name: &str,
) -> Result<(Backup, OwnedSemaphorePermit), BackupError> {
    maps.expect_own()?;
    let Ok(place) = maps.backups().try_acquire_owned() else { return Err(BackupError::Busy) };
    match maps.get(name) {
        Ok(map) => {
            if let Err(reason) = save::save(maps, &map).await {
                // The recording is enough, with an older checkpoint or none.
                tracing::warn!(map = name, reason, "a backup has no new checkpoint");
            }
        }
        Err(MapsError::Loading { .. } | MapsError::Map(MapError::Failed { .. })) => {}
        Err(error) => return Err(error.into()),
    }
    let (store, map) = (maps.store().clone(), name.to_owned());
    let opened = tokio::task::spawn_blocking(move || store.backup(&map)).await;
    let opened = opened.map_err(|_| MapsError::Panicked)?.map_err(MapsError::from)?;
    match opened {
        Some(backup) => Ok((backup, place)),
        None if maps.store().is_recording() => Err(BackupError::Empty { name: name.to_owned() }),
        None => Err(BackupError::NotRecorded),
    }
}

/// Puts a backup in place as a map of a name that is free; then it is loaded. Nothing is changed if the
/// backup is damaged, there is no room for it, or there are as many maps as there may be.
///
/// # Errors
/// [`BackupError`].
pub(crate) async fn restore(
    maps: &RecordedMaps,
    name: &str,
    tar: impl Read + Send + 'static,
) -> Result<Unpacked, BackupError> {
    check_name(name).map_err(MapsError::from)?;
    let Ok(place) = maps.restores().try_acquire_owned() else { return Err(BackupError::Busy) };
    let reserved = maps.reserve(name)?;
    let (store, map) = (maps.store().clone(), name.to_owned());
    // To the end even if the caller is gone, so that the name is free or has a map.
    let restored = tokio::task::spawn_blocking(move || {
        let restored = store.restore(&map, tar);
        if matches!(restored, Ok(Some(_))) {
            reserved.fill();
        }
        drop(place);
        restored
    });
    match restored.await.map_err(|_| MapsError::Panicked)? {
        Ok(Some(unpacked)) => Ok(unpacked),
        Ok(None) => Err(BackupError::NotRecorded),
        Err(BackupFault::Store(error)) => Err(MapsError::from(error).into()),
        Err(BackupFault::Refused(reason)) => Err(BackupError::Refused { reason }),
        Err(fault @ BackupFault::Slow(_)) => Err(BackupError::Slow { reason: fault.to_string() }),
    }
}
