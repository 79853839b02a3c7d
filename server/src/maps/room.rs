//! Warns in the log when recordings have little room, or none.

use super::recorded::RecordedMaps;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Between two looks.
const PAUSE: Duration = Duration::from_secs(10);

/// Logs each warning about the room of recordings once, until it is well again; ends when the server stops.
pub(crate) async fn watch_room(maps: RecordedMaps, stopping: CancellationToken) {
    let mut is_well = true;
    loop {
        let store = maps.store().clone();
        let warnings = tokio::task::spawn_blocking(move || store.warnings()).await;
        let warnings = warnings.unwrap_or_default();
        if is_well {
            warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        } else if warnings.is_empty() {
            tracing::info!("recordings have room again");
        }
        is_well = warnings.is_empty();
        if tokio::time::timeout(PAUSE, stopping.cancelled()).await.is_ok() {
            return;
        }
    }
}
