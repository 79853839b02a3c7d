//! How many optimiser steps are due, and the decay of the learning rates.
//!
//! A keyframe earns its color steps when it is inserted. Its language earns steps when the networks have
//! finished, which may be later than its last color step. Slow networks thus cost time and not quality.

use super::super::keyframes::StepKind;
use serde::{Deserialize, Serialize};

/// Learning rates decay over this last share of the earned steps.
const DECAY_SHARE: f32 = 0.1;
/// The smallest factor of a decayed learning rate.
const DECAY_FLOOR: f32 = 0.05;

/// Steps that were earned and are not taken yet.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(in super::super) struct StepBudget {
    per_keyframe: usize,
    language_every: usize,
    color_left: usize,
    language_left: usize,
    /// Color steps earned since none were left.
    earned: usize,
    taken: usize,
}

impl StepBudget {
    /// `per_keyframe`: color steps of a keyframe. Its language gets one for every `language_every` of them.
    pub fn new(per_keyframe: usize, language_every: usize) -> Self {
        Self {
            per_keyframe,
            language_every: language_every.max(1),
            color_left: 0,
            language_left: 0,
            earned: 0,
            taken: 0,
        }
    }

    /// Adds the color steps of a new keyframe.
    pub fn earn(&mut self) {
        if self.color_left == 0 {
            self.earned = 0;
        }
        self.color_left += self.per_keyframe;
        self.earned += self.per_keyframe;
    }

    /// Adds the language steps of a keyframe that has received its language.
    pub fn earn_language(&mut self) {
        self.language_left += self.per_keyframe.div_ceil(self.language_every);
    }

    pub fn color_left(&self) -> usize {
        self.color_left
    }

    pub fn language_left(&self) -> usize {
        self.language_left
    }

    /// Number of the next step, from 1.
    pub fn next_number(&self) -> usize {
        self.taken + 1
    }

    pub fn is_empty(&self) -> bool {
        self.color_left + self.language_left == 0
    }

    /// Counts a step that is taken.
    pub fn take(&mut self, kind: StepKind) {
        self.taken += 1;
        self.color_left = self.color_left.saturating_sub(usize::from(kind.color));
        self.language_left = self.language_left.saturating_sub(usize::from(kind.language));
    }

    /// Drops the steps that are left, since nothing is there that they could optimise.
    pub fn drop_left(&mut self) {
        self.color_left = 0;
        self.language_left = 0;
    }

    /// Whether something that happens every `every` steps is due after the last step.
    pub fn is_due(&self, every: usize) -> bool {
        self.taken.is_multiple_of(every.max(1))
    }

    /// Factor of the last step's learning rates of means and of the color head, [`DECAY_FLOOR`] to 1. Adam's
    /// steps do not shrink with the gradient, so the rates decay over the last steps that were earned without
    /// a pause. The next keyframe resets the factor to 1.
    pub fn learning_rate_decay(&self) -> f32 {
        let decay_steps = DECAY_SHARE * self.earned as f32;
        if decay_steps > 0.0 {
            ((self.color_left + 1) as f32 / decay_steps).clamp(DECAY_FLOOR, 1.0)
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLOR: StepKind = StepKind { color: true, language: false };
    const LANGUAGE: StepKind = StepKind { color: false, language: true };
    const BOTH: StepKind = StepKind { color: true, language: true };

    #[test]
    fn late_language_still_gets_its_steps() {
        let mut steps = StepBudget::new(5, 3);
        steps.earn();
        (0..5).for_each(|_| steps.take(COLOR));
        assert!(steps.is_empty());
        steps.earn_language();
        assert_eq!((steps.color_left(), steps.language_left()), (0, 2));
        steps.earn();
        steps.take(BOTH);
        assert_eq!((steps.color_left(), steps.language_left()), (4, 1));
        steps.take(LANGUAGE);
        assert_eq!((steps.color_left(), steps.language_left()), (4, 0));
        assert_eq!(steps.next_number(), 8);
        steps.drop_left();
        assert!(steps.is_empty());
    }

    #[test]
    fn learning_rates_decay_over_the_last_earned_steps() {
        let mut steps = StepBudget::new(100, 4);
        assert_eq!(steps.learning_rate_decay(), 1.0);
        steps.earn();
        let mut decay = || {
            steps.take(COLOR);
            steps.learning_rate_decay()
        };
        let decays: Vec<f32> = (0..100).map(|_| decay()).collect();
        assert!(decays[..91].iter().all(|decay| *decay == 1.0), "{decays:?}");
        assert!(decays[91..].is_sorted_by(|a, b| a > b), "{decays:?}");
        assert!((decays[99] - 0.1).abs() < 1e-6, "the last of ten: {}", decays[99]);
        steps.earn();
        assert_eq!(steps.learning_rate_decay(), 1.0, "the next keyframe resets it");
        for _ in 0..10 {
            steps.earn();
        }
        for _ in 0..1046 {
            steps.take(COLOR);
        }
        assert!(
            (steps.learning_rate_decay() - 0.5).abs() < 1e-6,
            "half of the decay steps are left"
        );
        (0..54).for_each(|_| steps.take(COLOR));
        assert_eq!(
            (steps.color_left(), steps.learning_rate_decay()),
            (0, DECAY_FLOOR),
            "the floor"
        );
    }
}
