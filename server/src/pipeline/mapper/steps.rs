//! How many optimiser steps are due, of what, and how warm.
//!
//! In: keyframes, and their languages, as they come. Out: the next step. A keyframe earns its steps when it
//! comes; its language earns steps when the networks are done with it, which may be later than the last of
//! color's. Steps of language go along with one in `language_every` of color, and alone when there are no more:
//! slow networks cost time, not language. It must not know the map.

use super::MapperConfig;

/// The share of the steps over which rates go down, and to what part of themselves.
const COOLING: f32 = 0.25;
const COLD: f32 = 0.05;

/// What one step optimises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Step {
    pub color: bool,
    pub language: bool,
}

/// Steps that were earned and not yet taken.
#[derive(Debug)]
pub(super) struct Steps {
    per_keyframe: usize,
    language_every: usize,
    color_left: usize,
    language_left: usize,
    /// Of color, since none were left.
    earned: usize,
    taken: usize,
}

impl Steps {
    pub fn new(config: &MapperConfig) -> Self {
        Self {
            per_keyframe: config.steps_per_keyframe,
            language_every: config.language_every.max(1),
            color_left: 0,
            language_left: 0,
            earned: 0,
            taken: 0,
        }
    }

    /// A keyframe has come.
    pub fn earn(&mut self) {
        if self.color_left == 0 {
            self.earned = 0;
        }
        self.color_left += self.per_keyframe;
        self.earned += self.per_keyframe;
    }

    /// A keyframe's language has come.
    pub fn earn_language(&mut self) {
        self.language_left += self.per_keyframe.div_ceil(self.language_every);
    }

    /// Steps of color that are left.
    pub fn color_left(&self) -> usize {
        self.color_left
    }

    /// Whether none is left.
    pub fn is_done(&self) -> bool {
        self.color_left + self.language_left == 0
    }

    /// The next step, which counts as taken.
    pub fn take(&mut self) -> Option<Step> {
        if self.is_done() {
            return None;
        }
        self.taken += 1;
        let color = self.color_left > 0;
        let is_time = !color || self.taken.is_multiple_of(self.language_every);
        let language = is_time && self.language_left > 0;
        self.color_left -= usize::from(color);
        self.language_left -= usize::from(language);
        Some(Step { color, language })
    }

    /// Whether what is done every so many steps is due after the last one.
    pub fn is_time(&self, every: usize) -> bool {
        self.taken.is_multiple_of(every.max(1))
    }

    /// What the rates of means and of the color head are multiplied by: 1, and less over the last of the steps
    /// that were earned without a rest, so that the map comes to rest as well (Adam's steps do not get
    /// smaller by themselves). With the next keyframe's steps it is 1 again.
    pub fn heat(&self) -> f32 {
        let cooling = COOLING * self.earned as f32;
        if cooling > 0.0 { (self.color_left as f32 / cooling).clamp(COLD, 1.0) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLOR: Step = Step { color: true, language: false };
    const BOTH: Step = Step { color: true, language: true };
    const LANGUAGE: Step = Step { color: false, language: true };

    fn steps(per_keyframe: usize, language_every: usize) -> Steps {
        let config = MapperConfig {
            steps_per_keyframe: per_keyframe,
            language_every,
            ..MapperConfig::default()
        };
        Steps::new(&config)
    }

    #[test]
    fn language_has_its_steps_however_late_it_comes() {
        let mut steps = steps(6, 3);
        steps.earn();
        steps.earn_language();
        let taken: Vec<Step> = std::iter::from_fn(|| steps.take()).collect();
        assert_eq!(taken, [COLOR, COLOR, BOTH, COLOR, COLOR, BOTH], "in time");

        steps.earn();
        let taken: Vec<Step> = std::iter::from_fn(|| steps.take()).collect();
        assert_eq!(taken, [COLOR; 6], "not there yet");
        assert!(steps.is_done());
        steps.earn_language();
        assert!(!steps.is_done());
        let taken: Vec<Step> = std::iter::from_fn(|| steps.take()).collect();
        assert_eq!(taken, [LANGUAGE; 2], "late");
    }

    #[test]
    fn rates_go_down_at_the_end_of_what_was_earned() {
        let mut steps = steps(40, 4);
        assert_eq!(steps.heat(), 1.0);
        steps.earn();
        let heats: Vec<f32> =
            std::iter::from_fn(|| steps.take().map(|_| steps.heat())).take(40).collect();
        assert!(heats[..30].iter().all(|heat| *heat == 1.0), "{heats:?}");
        assert!(heats[30..39].is_sorted_by(|a, b| a > b), "{heats:?}");
        assert_eq!(heats[39], COLD, "nothing stands still before its last step");
        steps.earn();
        assert_eq!(steps.heat(), 1.0, "and up again");
        for _ in 0..10 {
            steps.earn();
        }
        for _ in 0..385 {
            steps.take();
        }
        assert!((steps.heat() - 0.5).abs() < 1e-6, "half of what there is to cool over");
    }
}
