//! What a reader gets of a map, and what it may wait for.

use super::super::snapshot::MapSnapshot;
use std::sync::Arc;
use std::time::Duration;

/// What a reader waits for, and how long at most. Afterwards it gets what there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wait {
    /// Until the map has done all its work on the frames that it has received.
    pub settled: bool,
    /// Until it has also been refined.
    pub converged: bool,
    /// Until readers see the map after this frame.
    pub min_sequence: Option<u64>,
    /// How long.
    pub longest: Duration,
}

/// A snapshot, and whether it is the last one of the frames that were received.
#[derive(Clone)]
pub struct Reading {
    /// The newest snapshot.
    pub snapshot: Arc<MapSnapshot>,
    /// Whether no frame waited and no work was left when it was taken.
    pub settled: bool,
    /// Whether the map had been refined as well, or never is.
    pub converged: bool,
}

impl Reading {
    /// Whether this is what was waited for.
    pub(super) fn is_enough(&self, wait: &Wait) -> bool {
        let has_frame =
            wait.min_sequence.is_none_or(|wanted| self.snapshot.through >= Some(wanted));
        has_frame && (self.settled || !wait.settled) && (self.converged || !wait.converged)
    }
}
