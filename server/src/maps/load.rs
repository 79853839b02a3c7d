//! Loading a map: its newest checkpoint, then the frames that were recorded after it.

use super::places::Load;
use super::recorded::RecordedMaps;
use super::replay::{Replay, Replayed};
use crate::check::Limits;
use crate::pipeline::checkpoint::Checkpoint;
use crate::pipeline::map::Map;
use crate::store::{CheckpointFault, CheckpointReader, StoreError};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use tokio_util::sync::CancellationToken;

/// Loads maps, one after the other, until the server stops.
pub(crate) async fn keep_loading(maps: RecordedMaps, limits: Limits, stopping: CancellationToken) {
    while !stopping.is_cancelled() {
        load_in_turn(maps.clone(), limits, stopping.clone()).await;
        tokio::select! {
            () = maps.places().changed() => {}
            () = stopping.cancelled() => {}
        }
    }
}

/// Loads all maps that wait, one after the other, until none is left or the server stops.
async fn load_in_turn(maps: RecordedMaps, limits: Limits, stopping: CancellationToken) {
    while let Some((name, load)) = maps.places().next() {
        let stop = load.cancelled.clone();
        tokio::select! {
            () = load_one(&maps, &limits, &name, &load) => {}
            () = stopping.cancelled() => {
                stop.cancel();
                return;
            }
            // The map is being deleted.
            () = stop.cancelled() => {}
        }
    }
}

/// Loads all maps of the data directory.
///
/// # Errors
/// [`StoreError`] if the data directory cannot be listed.
#[cfg(test)]
pub(crate) async fn load_all(maps: &RecordedMaps, limits: &Limits) -> Result<(), StoreError> {
    maps.find_recordings()?;
    load_in_turn(maps.clone(), *limits, CancellationToken::new()).await;
    Ok(())
}

/// Loads one map. If it cannot be rebuilt, this is noted and its recording stays as it is.
async fn load_one(maps: &RecordedMaps, limits: &Limits, name: &str, load: &Arc<Load>) {
    let _loading = load.gate.lock().await;
    let began = Instant::now();
    let ended = match rebuild(maps, limits, name, load).await {
        Ok(replayed) => {
            let frames = replayed.frames;
            tracing::info!(
                map = name,
                frames,
                seconds = began.elapsed().as_secs_f64(),
                "loaded a map"
            );
            if let Ok(map) = maps.engine().map(name) {
                let words: Vec<String> =
                    maps.damage(name).into_iter().chain(replayed.words).collect();
                if !words.is_empty() {
                    map.note_damage(words.join("; "));
                }
                if replayed.is_saved {
                    maps.note_saved(name, (map.received_through(), map.status().revision));
                }
            }
            Ok(())
        }
        Err(reason) => {
            tracing::error!(map = name, reason, "cannot rebuild a map from its recording");
            // A part of it may be there. An error means that there is none.
            let _ = maps.engine().delete(name).await;
            Err(reason)
        }
    };
    maps.places().ended(name, load, ended);
}

async fn rebuild(
    maps: &RecordedMaps,
    limits: &Limits,
    name: &str,
    load: &Arc<Load>,
) -> Result<Replayed, String> {
    let unreadable = |error: StoreError| {
        tracing::error!(map = name, %error, "a recording cannot be read");
        error.reason()
    };
    let records = maps.store().records(name).map_err(unreadable)?;
    let (counted, records) = blocking(move || (records.count_frames(), records)).await?;
    load.set_total(counted.map_err(unreadable)?);
    let restored = restore(maps, name, load).await?;
    let mut replay = Replay::new(maps.engine(), limits, name, load, restored.map.as_deref());
    let replayed = replay.run(name, records).await?;
    // A map may be empty.
    let (engine, map) = (maps.engine().clone(), name.to_owned());
    let opened = blocking(move || engine.open(&map).map(drop)).await?;
    opened.map_err(|error| error.to_string())?;
    let is_saved = restored.map.is_some() && replayed.frames == 0;
    let words = restored.words.into_iter().chain(replayed.words).collect();
    Ok(Replayed { words, is_saved, ..replayed })
}

/// A map that was made of a checkpoint, and what is wrong with others, in words.
struct Restored {
    map: Option<Arc<Map>>,
    words: Vec<String>,
}

/// Makes the map of the newest checkpoint that is whole and was made by a server like this one.
async fn restore(maps: &RecordedMaps, name: &str, load: &Load) -> Result<Restored, String> {
    let files = maps.store().checkpoints(name).map_err(|error| error.reason())?;
    let mut words = Vec::new();
    for path in files {
        let file = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
        let (engine, map) = (maps.engine().clone(), name.to_owned());
        let restored = blocking(move || {
            let Some(saved) = read_checkpoint(&path, engine.fingerprint())? else {
                return Ok(None);
            };
            let frames = saved.frames();
            let map =
                engine.restore(&map, saved).map_err(|error| Unusable::Other(error.to_string()))?;
            Ok(Some((map, frames)))
        });
        match restored.await? {
            Ok(Some((map, frames))) => {
                load.set_done(frames);
                tracing::info!(map = name, file, frames, "a map goes on from a checkpoint");
                return Ok(Restored { map: Some(map), words });
            }
            Ok(None) => tracing::info!(
                map = name,
                file,
                "a checkpoint was made by another version, with other settings or networks: the map is \
                 rebuilt from its recording"
            ),
            Err(Unusable::Other(reason)) => {
                tracing::warn!(map = name, file, reason, "a checkpoint cannot be used");
            }
            Err(Unusable::Damaged(reason)) => {
                tracing::error!(map = name, file, reason, "a checkpoint cannot be used");
                words.push(format!("{file} is not used, the recording is: {reason}"));
            }
        }
    }
    Ok(Restored { map: None, words })
}

/// Why a checkpoint cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Unusable {
    #[error("{0}")]
    Damaged(String),
    #[error("{0}")]
    Other(String),
}

/// Reads a checkpoint; `None` if another server made it.
///
/// # Errors
/// [`Unusable`].
pub(crate) fn read_checkpoint(
    path: &Path,
    fingerprint: &str,
) -> Result<Option<Checkpoint>, Unusable> {
    let fault = |fault: CheckpointFault| match fault {
        CheckpointFault::Damaged(_) => Unusable::Damaged(fault.to_string()),
        CheckpointFault::Store(error) => Unusable::Other(error.reason()),
        CheckpointFault::OtherVersion(_) => Unusable::Other(fault.to_string()),
    };
    let mut reader = CheckpointReader::open(path).map_err(fault)?;
    if reader.label().fingerprint != fingerprint {
        // A flipped bit looks like another server too.
        reader.finish().map_err(fault)?;
        return Ok(None);
    }
    let through = reader.label().through;
    let saved = Checkpoint::read(&mut reader);
    reader.finish().map_err(fault)?;
    let saved = saved.map_err(|error| Unusable::Damaged(error.to_string()))?;
    if saved.through() != Some(through) {
        return Err(Unusable::Damaged("its label is of another state".into()));
    }
    Ok(Some(saved))
}

/// Runs slow work on a blocking thread.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, String> {
    tokio::task::spawn_blocking(work).await.map_err(|_| "loading the map panicked".to_owned())
}
