//! Whether poses and depths fit together as they were sent, and if not, how they were meant.
//!
//! In: the fits of pairs of frames under every reading. Out: the reading that explains nearly all pairs far
//! better than what was sent, if there is one. If none explains them (poses that belong to other frames),
//! nothing is said.

use super::super::saving::packed;
use super::fit::{Fit, fits};
use super::reading::{CONVENTIONS, Reading, depth_factors};
use super::small_frame::SmallFrame;
use serde::{Deserialize, Serialize};

/// Pairs that a verdict needs.
const LEAST_PAIRS: usize = 8;
/// Pairs that a verdict on a factor near 1 needs.
const LEAST_PAIRS_NEAR: usize = 20;
/// Pairs after which no more are looked at.
const MOST_PAIRS: usize = 44;
/// A factor within this of 1 is near. Beside a wrong convention it is not told.
const NEAR: f32 = 1.3;
/// A factor within this of 1 is not worth a word: poses and depths of real sensors are no better.
const UNNOTICED: f32 = 1.08;
/// A pair that no reading explains better than this tells nothing.
const EXPLAINED: f32 = 0.4;
/// Neither does one that all readings of similar depths explain equally well, within this cost.
const TELLING: f32 = 0.1;
/// A reading is right only if it leaves a lower mean cost than this.
const GOOD: f32 = 0.3;
/// ... and at most this share of the cost of what was sent, and a lower one in this share of the pairs.
const BETTER: f32 = 0.7;
const WINS: f32 = 0.85;
/// The same for a factor near 1.
const BETTER_NEAR: f32 = 0.85;
const WINS_NEAR: f32 = 0.95;
/// A pair is won if its cost is lower by this.
const CLEARLY: f32 = 0.01;
/// With depth this many times larger or smaller a reading must cost `SHARP` times more. Otherwise the scale
/// cannot be seen: frames of a camera that only turns fit with any.
const FAR: f32 = 4.0;
const SHARP: f32 = 1.3;

/// A reading that explains the frames better than what was sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Verdict {
    pub reading: Reading,
    /// Mean share of the shared surface that agrees as sent, 0 to 1.
    pub agreeing_sent: f32,
    /// The same under the reading.
    pub agreeing: f32,
    /// Pairs of frames that were compared.
    pub pairs: usize,
    /// Pairs that the reading explains better.
    pub won: usize,
}

/// Collects pairs of frames.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct PoseCheck {
    #[serde(with = "packed")]
    factors: Vec<f32>,
    /// Index of the reading of what was sent.
    sent: usize,
    /// Fits of each pair under each reading.
    pairs: Vec<Vec<Fit>>,
}

impl PoseCheck {
    pub fn new() -> Self {
        let factors = depth_factors();
        let sent = factors.partition_point(|factor| *factor < 1.0);
        Self { factors, sent, pairs: Vec::new() }
    }

    /// Adds a pair of frames, if both have poses, and some reading explains it better than others.
    pub fn add(&mut self, a: &SmallFrame, b: &SmallFrame) {
        let pair = fits(a, b, &self.factors).filter(|fits| self.is_telling(fits));
        self.pairs.extend(pair);
    }

    fn is_telling(&self, fits: &[Fit]) -> bool {
        let factor = |at: usize| self.factors[at % self.factors.len()];
        let lowest = (0..fits.len()).min_by(|a, b| fits[*a].cost.total_cmp(&fits[*b].cost));
        let Some(best) = lowest else { return false };
        let range = factor(best) / FAR..factor(best) * FAR;
        let others = fits.iter().enumerate().filter(|(at, _)| range.contains(&factor(*at)));
        let worst = others.map(|(_, fit)| fit.cost).fold(0.0, f32::max);
        fits[best].cost < EXPLAINED && worst > fits[best].cost + TELLING
    }

    /// Whether enough pairs were seen.
    pub fn is_full(&self) -> bool {
        self.pairs.len() >= MOST_PAIRS
    }

    /// The reading that is better than what was sent.
    pub fn verdict(&self) -> Option<Verdict> {
        if self.pairs.len() < LEAST_PAIRS {
            return None;
        }
        let costs: Vec<f32> =
            (0..self.readings()).map(|at| self.mean(|fits| fits[at].cost)).collect();
        let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
        let is_won = |fits: &&Vec<Fit>| fits[best].cost < fits[self.sent].cost - CLEARLY;
        let won = self.pairs.iter().filter(is_won).count();
        let convention = CONVENTIONS[best / self.factors.len()];
        let mut depth_factor = self.depth_factor(best, &costs)?;
        if is_near(depth_factor) && !convention.is_right() {
            depth_factor = 1.0;
        }
        let verdict = Verdict {
            reading: Reading { convention, depth_factor },
            agreeing_sent: self.mean(|fits| fits[self.sent].agreeing),
            agreeing: self.mean(|fits| fits[best].agreeing),
            pairs: self.pairs.len(),
            won,
        };
        let is_better = |share: f32, wins: f32| {
            costs[best] < GOOD.min(share * costs[self.sent])
                && won as f32 >= wins * verdict.pairs as f32
        };
        let is_sure = if is_near(depth_factor) && convention.is_right() {
            depth_factor.max(1.0 / depth_factor) > UNNOTICED
                && verdict.pairs >= LEAST_PAIRS_NEAR
                && is_better(BETTER_NEAR, WINS_NEAR)
        } else {
            is_better(BETTER, WINS)
        };
        is_sure.then_some(verdict)
    }

    fn readings(&self) -> usize {
        CONVENTIONS.len() * self.factors.len()
    }

    fn mean(&self, value: impl Fn(&Vec<Fit>) -> f32) -> f32 {
        self.pairs.iter().map(value).sum::<f32>() / self.pairs.len() as f32
    }

    /// The factor of depth at the lowest cost, between the factors that were tried; 1 if it is near and
    /// cannot be seen well. `None` if it is far and depths of another scale would fit nearly as well.
    fn depth_factor(&self, best: usize, costs: &[f32]) -> Option<f32> {
        let at = best % self.factors.len();
        let costs = &costs[best - at..best - at + self.factors.len()];
        if at == self.sent {
            return Some(1.0);
        }
        let factor = self.factors[at];
        let below = self.factors.iter().rposition(|other| *other <= factor / FAR)?;
        let above = self.factors.iter().position(|other| *other >= factor * FAR)?;
        if costs[below].min(costs[above]) < SHARP * costs[at] {
            return is_near(factor).then_some(1.0);
        }
        let near = [at - 1, at, at + 1];
        let [x0, x1, x2] = near.map(|at| self.factors[at].ln());
        let [y0, y1, y2] = near.map(|at| costs[at]);
        // Depths differ by a share that grows evenly to both sides: two lines of opposite slope.
        let slope = ((y0 - y1) / (x1 - x0)).max((y2 - y1) / (x2 - x1));
        let lowest = if slope > 0.0 { (x0 + x2 + (y0 - y2) / slope) / 2.0 } else { x1 };
        Some(lowest.exp())
    }
}

/// Whether a factor is near 1.
fn is_near(factor: f32) -> bool {
    factor.max(1.0 / factor) < NEAR
}
