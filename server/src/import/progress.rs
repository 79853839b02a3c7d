//! How far a recording is mapped.

use lexsplat_proto::json::{self, ImportState};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio_util::sync::CancellationToken;

/// A recording on its way into a map.
#[derive(Default)]
pub(super) struct Import {
    told: Mutex<json::Import>,
    /// Cancelled when somebody stops it.
    pub stop: CancellationToken,
    /// Cancelled when it has ended, and the map is free for others.
    pub ended: CancellationToken,
}

impl Import {
    pub(super) fn told(&self) -> MutexGuard<'_, json::Import> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn is_running(&self) -> bool {
        matches!(self.told().state, ImportState::Receiving | ImportState::Mapping)
    }
}
