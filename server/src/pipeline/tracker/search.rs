//! The search for the pose of one frame: the best result so far, and whether it ends the search.

use super::candidate::PoseCandidate;
use super::config::TrackerConfig;
use super::judge::Judge;

/// Two poses nearer than this are the same, metres,
const SAME_METRES: f64 = 0.005;
/// and radians.
const SAME_RADIANS: f64 = 0.005;

/// Where an alignment started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// Near where the camera is expected.
    Prediction,
    /// From the robot's own estimate while the camera is lost.
    Guess,
    /// From anywhere.
    Jump,
}

/// Collects the results of alignments from several starts.
pub(super) struct Search<'a> {
    config: &'a TrackerConfig,
    judge: &'a Judge,
    sequence: u64,
    best: Option<PoseCandidate>,
    is_done: bool,
}

impl<'a> Search<'a> {
    pub fn new(config: &'a TrackerConfig, judge: &'a Judge, sequence: u64) -> Self {
        Self { config, judge, sequence, best: None, is_done: false }
    }

    /// Adds the result of an alignment. `what` names it in the log.
    pub fn add(&mut self, what: &'static str, origin: Origin, found: PoseCandidate) {
        let (config, quality) = (self.config, &found.quality);
        tracing::debug!(self.sequence, what, ?quality, exposure = ?found.exposure);
        let is_accepted = match origin {
            Origin::Prediction => quality.is_tracked(config),
            Origin::Guess | Origin::Jump => quality.is_relocalised(config),
        };
        if !is_accepted || !self.judge.is_believable(quality, config) {
            return;
        }
        // Two starts that end at the same pose confirm each other.
        let is_confirmed = self.best.as_ref().is_some_and(|best| {
            let off = best.world_from_camera.inverse() * found.world_from_camera;
            off.translation.vector.norm() < SAME_METRES && off.rotation.angle() < SAME_RADIANS
        });
        self.is_done |= is_confirmed || self.judge.is_convincing(quality, config);
        let is_better = |best: &PoseCandidate| found.quality.agreement > best.quality.agreement;
        if self.best.as_ref().is_none_or(is_better) {
            self.best = Some(PoseCandidate { jumped: origin == Origin::Jump, ..found });
        }
    }

    /// Whether a result is convincing, so that no other start needs to be tried.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Whether a result is believable.
    pub fn has_found(&self) -> bool {
        self.best.is_some()
    }

    /// The believable result that agrees best with the map.
    pub fn best(self) -> Option<PoseCandidate> {
        self.best
    }
}
