//! Renaming maps.

use super::error::MapsError;
use super::recorded::RecordedMaps;
use super::save;
use crate::pipeline::engine::check_name;

/// Why a map keeps its name.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RenameError {
    #[error(transparent)]
    Maps(#[from] MapsError),
    #[error("the map is only in memory, since the server has no data directory (--data-dir)")]
    NotRecorded,
}

/// Gives a map another name, to the end even if the caller is gone. The map is saved, its folder is renamed,
/// and then it is loaded again. Meanwhile both names are taken.
///
/// # Errors
/// [`RenameError`]: the new name is invalid or taken, somebody sends frames, or the map cannot be kept.
pub(crate) async fn rename(maps: &RecordedMaps, name: &str, to: &str) -> Result<(), RenameError> {
    check_name(to).map_err(MapsError::from)?;
    let (maps, name, to) = (maps.clone(), name.to_owned(), to.to_owned());
    let renamed = tokio::spawn(async move { rename_now(&maps, &name, &to).await }).await;
    renamed.map_err(|_| MapsError::Panicked)?
}

async fn rename_now(maps: &RecordedMaps, name: &str, to: &str) -> Result<(), RenameError> {
    let map = maps.loaded(name).await?;
    let new = maps.reserve_renamed(to)?;
    let sender = map.claim().map_err(MapsError::from)?;
    let is_recorded = maps.is_recorded(name);
    if !is_recorded && map.received_through().is_some() {
        return Err(RenameError::NotRecorded);
    }
    let old = maps.places().reserve(name).map_err(MapsError::from)?;
    if let Err(reason) = save::save(maps, &map).await {
        // The recording is enough, with an older checkpoint or none.
        tracing::warn!(map = name, reason, "a renamed map has no new checkpoint");
    }
    drop((sender, map));
    maps.engine().delete(name).await.map_err(MapsError::from)?;
    maps.note_gone(name);
    if !is_recorded {
        drop((old, new));
        maps.create(to).await?;
        return Ok(());
    }
    match maps.store().rename(name, to).await {
        Ok(()) => {
            new.fill();
            tracing::info!(map = name, to, "a map was renamed");
            Ok(())
        }
        Err(error) => {
            // It is loaded again under its old name.
            old.fill();
            Err(MapsError::from(error).into())
        }
    }
}
