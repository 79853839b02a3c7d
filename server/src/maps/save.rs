//! Writing checkpoints: now and then while the server runs, and when it stops.

use super::recorded::RecordedMaps;
use crate::pipeline::map::Map;
use crate::store::{Label, StoreError};
use crate::telemetry::CHECKPOINT_SECONDS;
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

/// The pause is at least so many times as long as writing took: on a slow disk there are fewer checkpoints.
const LEAST_PAUSE: u32 = 10;

/// Writes checkpoints of all maps that changed, every so often, until the server stops.
pub(crate) async fn save_every(maps: RecordedMaps, pause: Duration, stopping: CancellationToken) {
    let mut took = Duration::ZERO;
    while tokio::time::timeout(pause.max(took * LEAST_PAUSE), stopping.cancelled()).await.is_err() {
        let began = Instant::now();
        save_all(&maps).await;
        took = began.elapsed();
    }
}

/// Writes checkpoints of all maps that changed since their last one. One that cannot be written is reported:
/// its frames are in the recording.
pub(crate) async fn save_all(maps: &RecordedMaps) {
    for map in maps.engine().maps() {
        // It was told, and is tried again.
        let _ = save(maps, &map).await;
    }
}

/// Writes a checkpoint of a map if it changed since the last one. If that is not possible, the log says so.
///
/// # Errors
/// The reason, without a path of the server.
pub(crate) async fn save(maps: &RecordedMaps, map: &Map) -> Result<(), String> {
    let state = (map.received_through(), map.status().revision);
    // A map that has failed keeps its last checkpoint.
    if !maps.is_recorded(map.name())
        || map.failure().is_some()
        || !maps.is_unsaved(map.name(), state)
    {
        return Ok(());
    }
    let began = Instant::now();
    let saved = map.save().await.inspect_err(|reason| {
        tracing::error!(map = map.name(), reason, "cannot write a checkpoint");
    })?;
    let Some(through) = saved.through() else { return Ok(()) };
    let fingerprint = maps.engine().fingerprint().to_owned();
    let label = Label { map: map.name().to_owned(), fingerprint, through, frames: saved.frames() };
    let store = maps.store().clone();
    let written = tokio::task::spawn_blocking(move || {
        store.save(&label, |mut out| saved.write(&mut out).map_err(std::io::Error::other))
    });
    let written = written.await.map_err(|_| "writing panicked".to_owned())?;
    let bytes = written.map_err(|error| {
        // Little room is told once, with the other warnings of the store.
        if !matches!(error, StoreError::Quota { .. }) {
            tracing::error!(map = map.name(), %error, "cannot write a checkpoint");
        }
        error.reason()
    })?;
    let seconds = began.elapsed();
    metrics::histogram!(CHECKPOINT_SECONDS).record(seconds);
    tracing::info!(map = map.name(), through, bytes, seconds = seconds.as_secs_f64(), "checkpoint");
    maps.note_saved(map.name(), state);
    Ok(())
}
