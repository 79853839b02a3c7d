//! Writing checkpoints of a map that this worker has.

use super::acks::AckLog;
use super::bus::{Bus, Failed};
use super::checkpoints::{self, Beginning};
use super::config::Trim;
use super::copies::Copies;
use super::registry::{self, ChangeError, Saved};
use crate::check::Limits;
use crate::pipeline::engine::Engine;
use crate::pipeline::map::Map;
use crate::telemetry::FLEET_CHECKPOINT_FAILURES;
use lexsplat_proto::v1;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long the acknowledgements of a checkpoint's frames may take.
const ACKNOWLEDGED_WITHIN: Duration = Duration::from_secs(10);

/// What all maps of a worker share.
#[derive(Clone)]
pub(super) struct Terms {
    pub bus: Bus,
    pub engine: Arc<Engine>,
    pub limits: Limits,
    /// Between two checkpoints of a map that changes; zero: only at the end.
    pub checkpoint_every: Duration,
    pub trim: Trim,
    pub copies: Copies,
}

/// Where a frame is in the log.
pub(super) struct Position {
    pub sequence: u64,
    pub first: u64,
    pub last: u64,
    /// The opening message of its stream.
    pub open: Arc<v1::OpenMap>,
}

/// Frames that no checkpoint has, oldest first.
pub(super) type Positions = Arc<Mutex<VecDeque<Position>>>;

/// Writes checkpoints of a map.
pub(super) struct Saver {
    pub terms: Terms,
    pub map: String,
    pub id: String,
    pub token: u64,
    pub acks: Arc<AckLog>,
    pub positions: Positions,
}

impl Saver {
    /// Writes a checkpoint if the map has frames that none has.
    pub(super) async fn save(&self, map: &Map) -> Result<(), ChangeError> {
        let saved = self.try_save(map).await;
        if let Err(ChangeError::Failed(error)) = &saved {
            metrics::counter!(FLEET_CHECKPOINT_FAILURES).increment(1);
            tracing::error!(%error, map = self.map, "a checkpoint was not written: the log has the frames");
        }
        saved
    }

    async fn try_save(&self, map: &Map) -> Result<(), ChangeError> {
        let failed = |reason: String| Failed::new("copying the map", reason);
        if !self.has_new(map.received_through()) {
            return Ok(());
        }
        let taken_at = registry::now();
        let state = map.save().await.map_err(failed)?;
        let Some(through) = state.through() else { return Ok(()) };
        let Some((first, position, open)) = self.position_of(through) else { return Ok(()) };
        let began = Instant::now();
        while !self.acks.has(through) {
            if began.elapsed() > ACKNOWLEDGED_WITHIN {
                // Without them, whoever waits for them would wait for ever.
                return Err(failed("its newest acknowledgements are late".into()).into());
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        let saved = Saved {
            object: checkpoints::object_of(&self.terms.bus, &self.map, self.token, through),
            fingerprint: self.terms.engine.fingerprint().to_owned(),
            through,
            position,
            token: self.token,
            taken_at: taken_at.as_secs(),
        };
        let beginning = Beginning { open: Some(open), acks: self.acks.through(through) };
        let bus = &self.terms.bus;
        let bytes = checkpoints::write(bus, &self.map, &saved, beginning, state).await?;
        let object = saved.object.clone();
        let changed = registry::set_checkpoint(bus, &self.map, &self.id, saved).await;
        let (before, revision) = match changed {
            Ok(changed) => changed,
            Err(error) => {
                // One whose answer was lost may be the newest now.
                if matches!(error, ChangeError::Fenced | ChangeError::Deleted) {
                    registry::forget(bus, &object).await;
                }
                return Err(error);
            }
        };
        tracing::info!(map = self.map, token = self.token, through, revision, bytes, "checkpoint");
        if let Some(before) = before.filter(|before| before.object != object) {
            registry::forget(bus, &before.object).await;
        }
        self.forget_through(through);
        if self.terms.trim == Trim::Checkpoint {
            bus.trim(&self.map, first).await?;
        }
        Ok(())
    }

    /// Whether the map has frames that no checkpoint has.
    fn has_new(&self, received_through: Option<u64>) -> bool {
        let positions = self.positions.lock().unwrap_or_else(PoisonError::into_inner);
        let oldest = positions.front().map(|position| position.sequence);
        oldest.is_some_and(|oldest| received_through.is_some_and(|through| oldest <= through))
    }

    /// Positions of the first and last part of a frame, and the opening message of its stream.
    fn position_of(&self, sequence: u64) -> Option<(u64, u64, v1::OpenMap)> {
        let positions = self.positions.lock().unwrap_or_else(PoisonError::into_inner);
        let found = positions.iter().find(|position| position.sequence == sequence)?;
        Some((found.first, found.last, (*found.open).clone()))
    }

    fn forget_through(&self, sequence: u64) {
        let mut positions = self.positions.lock().unwrap_or_else(PoisonError::into_inner);
        positions.retain(|position| position.sequence > sequence);
    }
}
