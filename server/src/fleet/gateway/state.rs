//! What the interfaces of a gateway share.

use super::super::acks::Waiting;
use super::super::bus::Bus;
use super::super::config::FleetConfig;
use super::directory::Directory;
use crate::maps::{Listed, LoadProgress};
use crate::pipeline::map::MapStatus;
use crate::telemetry::{FLEET_OLDEST_UNACKNOWLEDGED, FLEET_UNOWNED_MAPS};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Between two looks at what waits.
const LOOK: Duration = Duration::from_secs(1);

/// A gateway of a fleet. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Gateway {
    pub(super) bus: Bus,
    pub(super) directory: Directory,
    pub(super) waiting: Waiting,
    /// How long an acknowledgement may take before it is asked for again.
    pub(super) patience: Duration,
    /// Whether frames can be taken.
    pub(super) is_ready: Arc<AtomicBool>,
}

impl Gateway {
    /// A gateway. `wait`: how long callers wait for a map that no worker has loaded yet.
    pub(crate) async fn new(
        bus: Bus,
        config: &FleetConfig,
        wait: Duration,
        stopping: &CancellationToken,
    ) -> Self {
        let lease_time = Duration::from_secs_f64(config.lease_seconds);
        let directory = Directory::new(&bus, lease_time, wait, stopping).await;
        Self {
            bus,
            directory,
            waiting: Waiting::default(),
            patience: lease_time / 2,
            is_ready: Arc::new(true.into()),
        }
    }

    /// Looks whether the log can be used, and measures what waits, until `stopping` is cancelled.
    pub(crate) async fn watch(self, stopping: CancellationToken) {
        while tokio::time::timeout(LOOK, stopping.cancelled()).await.is_err() {
            self.is_ready.store(self.bus.is_working().await, Ordering::Relaxed);
            metrics::gauge!(FLEET_OLDEST_UNACKNOWLEDGED).set(self.waiting.oldest().as_secs_f64());
            metrics::gauge!(FLEET_UNOWNED_MAPS).set(self.directory.unowned() as f64);
        }
        self.is_ready.store(false, Ordering::Relaxed);
    }
}

/// A map that no worker has loaded.
pub(super) fn unloaded(map: &str) -> Listed {
    let loading = Some(LoadProgress { frames_done: 0, frames_total: 0 });
    Listed { status: MapStatus::absent(map), loading }
}

/// Header of a request: seconds that the map may be old which it is answered from.
pub(super) const MAX_STALENESS: &str = "lexsplat-max-staleness";
/// Header of an answer from a checkpoint: its age, seconds.
pub(super) const AGE: &str = "lexsplat-age";

/// The value of [`MAX_STALENESS`].
///
/// # Errors
/// What was expected.
pub(super) fn max_staleness(text: Option<&str>) -> Result<Option<Duration>, String> {
    let Some(text) = text else { return Ok(None) };
    let seconds = text.trim().parse::<f64>().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    seconds.map(Some).ok_or_else(|| format!("{MAX_STALENESS}: expected seconds, found {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn staleness_is_in_seconds() {
        assert_eq!(max_staleness(None), Ok(None));
        assert_eq!(max_staleness(Some(" 1.5 ")), Ok(Some(Duration::from_millis(1500))));
        for wrong in ["", "-1", "nan", "1 min", "1e300"] {
            assert!(
                max_staleness(Some(wrong)).unwrap_err().contains("expected seconds"),
                "{wrong}"
            );
        }
    }
}
