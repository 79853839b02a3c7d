//! How far the refinement of a map at full size has come: what is to be visited next, and whether the map has
//! converged.
//!
//! Refinement goes through the windows of all keyframes, each once in a sweep, in random order. Learning
//! rates fall from sweep to sweep. It ends when a sweep's mean loss is hardly lower than that of the sweep
//! before, or after a number of sweeps. A new keyframe begins it anew.

use rand::Rng;
use rand::seq::SliceRandom as _;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Factor of the learning rates in the last permitted sweep.
const LAST_RATE: f32 = 0.05;
/// A sweep that lowers the mean loss by less than this share is the last one.
const LEAST_GAIN: f64 = 0.01;
/// Sweeps that are made in any case: rates are high in the first ones, and the loss may rise.
const LEAST_SWEEPS: usize = 4;

/// A window of a keyframe's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(in super::super) struct Window {
    /// Sequence number of the keyframe.
    pub sequence: u64,
    /// Which of its windows, row by row.
    pub index: usize,
}

/// See the module.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(in super::super) struct Refinement {
    /// Windows that are left of the current sweep, the next one last.
    left: Vec<Window>,
    /// Windows whose detail was inserted.
    detailed: BTreeSet<Window>,
    /// Sum and number of the losses in the current sweep.
    losses: (f64, usize),
    /// Mean loss of the sweep before.
    before: Option<f64>,
    /// Completed sweeps since the newest keyframe.
    sweeps: usize,
    /// Steps taken so far.
    steps: usize,
    has_ended: bool,
}

impl Refinement {
    /// The map has a new keyframe.
    pub fn begin_anew(&mut self) {
        let Self { detailed, steps, .. } = std::mem::take(self);
        *self = Self { detailed, steps, ..Self::default() };
    }

    /// Whether the map has converged, or has had all the sweeps that it may have.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Whether the detail of a window was inserted; from now on it counts as inserted.
    pub fn is_detailed(&mut self, window: Window) -> bool {
        !self.detailed.insert(window)
    }

    /// Whether detail of a keyframe was inserted.
    pub fn has_detail_of(&self, sequence: u64) -> bool {
        let (first, last) = (Window { sequence, index: 0 }, Window { sequence, index: usize::MAX });
        self.detailed.range(first..=last).next().is_some()
    }

    /// Takes the next window. A new sweep goes through `windows`.
    pub fn next(
        &mut self,
        windows: impl Iterator<Item = Window>,
        rng: &mut impl Rng,
    ) -> Option<Window> {
        if self.left.is_empty() {
            self.left = windows.collect();
            self.left.shuffle(rng);
        }
        self.left.pop()
    }

    /// Factor of the learning rates in the current sweep, of at most `most_sweeps`.
    pub fn rate(&self, most_sweeps: usize) -> f32 {
        let share = self.sweeps as f32 / most_sweeps.saturating_sub(1).max(1) as f32;
        LAST_RATE.powf(share)
    }

    /// Counts a step and its loss. The last one of a sweep decides whether another follows, of at most
    /// `most_sweeps`.
    pub fn count(&mut self, loss: f32, most_sweeps: usize) {
        self.steps += 1;
        if loss.is_finite() {
            self.losses.0 += f64::from(loss);
            self.losses.1 += 1;
        }
        if !self.left.is_empty() {
            return;
        }
        let (sum, count) = std::mem::take(&mut self.losses);
        let mean = sum / count.max(1) as f64;
        self.sweeps += 1;
        let gained = self.before.is_none_or(|before| mean < before * (1.0 - LEAST_GAIN));
        self.before = Some(mean);
        let may_end = self.sweeps >= LEAST_SWEEPS;
        self.has_ended = self.sweeps >= most_sweeps || (may_end && !gained);
        tracing::info!(sweep = self.sweeps, loss = mean, "refined");
    }

    /// Whether something that happens every `every` steps is due after the last step.
    pub fn is_due(&self, every: usize) -> bool {
        self.steps.is_multiple_of(every.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    const MOST: usize = 9;

    fn windows(keyframes: u64) -> impl Iterator<Item = Window> {
        (0..keyframes).flat_map(|sequence| (0..4).map(move |index| Window { sequence, index }))
    }

    /// Makes a sweep through two keyframes, in which each step has this loss. Returns the order.
    fn sweep(refinement: &mut Refinement, loss: f32) -> Vec<Window> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut step = || {
            let window = refinement.next(windows(2), &mut rng).unwrap();
            refinement.count(loss, MOST);
            window
        };
        (0..8).map(|_| step()).collect()
    }

    #[test]
    fn a_sweep_visits_each_window_once() {
        let mut refinement = Refinement::default();
        let mut visited = sweep(&mut refinement, 1.0);
        assert!(!visited.is_sorted(), "in random order");
        visited.sort_unstable();
        assert_eq!(visited, windows(2).collect::<Vec<_>>());
        assert_eq!(Refinement::default().next(windows(0), &mut rand::rng()), None);
    }

    #[test]
    fn it_ends_when_the_loss_stands_still_or_after_the_last_sweep() {
        let sweeps_of = |share: f32| {
            let mut refinement = Refinement::default();
            let mut loss = 1.0;
            while !refinement.has_ended() {
                sweep(&mut refinement, loss);
                loss *= share;
            }
            refinement.sweeps
        };
        assert_eq!(sweeps_of(0.98), MOST, "it falls all the time");
        assert_eq!(sweeps_of(0.995), LEAST_SWEEPS, "it hardly falls");
        let mut unknown = Refinement::default();
        (0..LEAST_SWEEPS).for_each(|_| _ = sweep(&mut unknown, f32::NAN));
        assert!(unknown.has_ended(), "nothing is measured");
    }

    #[test]
    fn rates_fall_and_a_new_keyframe_raises_them_again() {
        let mut refinement = Refinement::default();
        assert_eq!(refinement.rate(MOST), 1.0);
        sweep(&mut refinement, 1.0);
        let rate = refinement.rate(MOST);
        assert!(rate < 1.0 && rate > LAST_RATE, "{rate}");
        (0..MOST - 2).for_each(|_| _ = sweep(&mut refinement, 1.0));
        assert!((refinement.rate(MOST) - LAST_RATE).abs() < 1e-6);
        assert!(refinement.has_ended());
        refinement.begin_anew();
        assert!(!refinement.has_ended());
        assert_eq!(refinement.rate(MOST), 1.0);
    }

    #[test]
    fn detail_is_inserted_once() {
        let mut refinement = Refinement::default();
        let window = Window { sequence: 7, index: 3 };
        assert!(!refinement.has_detail_of(7));
        assert!(!refinement.is_detailed(window), "the first time");
        assert!(refinement.is_detailed(window));
        refinement.begin_anew();
        assert!(refinement.is_detailed(window), "also with a new keyframe");
        assert!(refinement.has_detail_of(7) && !refinement.has_detail_of(6));
        assert!(!refinement.is_detailed(Window { index: 2, ..window }), "another window");
    }
}
