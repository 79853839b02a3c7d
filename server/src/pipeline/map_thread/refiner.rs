//! When a map is refined, and when readers get what came of it.
//!
//! With the clock `realtime` a map is refined whenever nothing else is to be done. With `per_frame` that
//! would make the map depend on the time between two frames, so it is refined only while a reader waits.

use super::super::live_map::LiveMap;
use super::super::map::Refinement;
use super::super::mapper::{Clock, MapperConfig};
use std::time::Duration;

/// While a map is refined readers get a snapshot every so many times `mapper.snapshot_seconds`: a copy costs
/// as much as before, and changes less.
const SNAPSHOT_INTERVALS: f64 = 10.0;

/// Decides about the refinement of one map.
pub(super) struct Refiner {
    is_enabled: bool,
    clock: Clock,
    snapshot_seconds: f64,
    /// A reader waits for the refined map.
    is_wanted: bool,
    /// Readers lack the newest steps.
    has_changes: bool,
}

impl Refiner {
    pub fn new(config: &MapperConfig) -> Self {
        Self {
            is_enabled: config.refine_sweeps > 0,
            clock: config.clock,
            snapshot_seconds: SNAPSHOT_INTERVALS * config.snapshot_seconds,
            is_wanted: false,
            has_changes: false,
        }
    }

    /// A reader waits for the refined map.
    pub fn want(&mut self) {
        self.is_wanted = true;
    }

    /// Whether a map without other work is to be refined.
    pub fn is_due(&self, live: &LiveMap) -> bool {
        let may = self.clock == Clock::Realtime || self.is_wanted;
        self.is_enabled && may && !is_done(live)
    }

    /// What readers are told.
    pub fn state(&self, live: &LiveMap, is_idle: bool) -> Refinement {
        if !self.is_enabled {
            Refinement::Off
        } else if is_done(live) {
            Refinement::Converged
        } else if is_idle && self.is_due(live) {
            Refinement::Refining
        } else {
            Refinement::Waiting
        }
    }

    /// A step changed the map.
    pub fn changed(&mut self) {
        self.has_changes = true;
    }

    /// Whether readers are to get the newest steps, `age` after their last snapshot. After that they have
    /// them. With the clock `per_frame` they get them at the end.
    pub fn publishes(&mut self, live: &LiveMap, age: Duration) -> bool {
        let is_old = self.clock == Clock::Realtime && age.as_secs_f64() >= self.snapshot_seconds;
        let publishes = self.has_changes && (is_old || is_done(live));
        if publishes {
            self.has_changes = false;
        }
        self.is_wanted &= !is_done(live);
        publishes
    }
}

/// Whether the map has converged. There is nothing to refine in an empty one.
fn is_done(live: &LiveMap) -> bool {
    live.gaussians.is_empty() || live.refinement.has_ended()
}
