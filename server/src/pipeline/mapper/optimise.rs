//! One optimiser step on one view: the one that had the fewest so far, or any.

use super::{Mapper, MapperConfig};
use crate::telemetry::{MAPPING_SECONDS, timed};
use lexsplat_gpu::{GpuError, HeadRates, LearningRates, LossWeights, TrainingView};
use rand::Rng;
use std::cmp::Reverse;

/// The share of the steps over which rates go down, and to what part of themselves.
const COOLING: f32 = 0.25;
const COLD: f32 = 0.05;

impl Mapper {
    /// Takes one of the steps that are left.
    pub(super) fn optimise_once(&mut self) -> Result<(), GpuError> {
        timed(MAPPING_SECONDS, || self.step())
    }

    fn step(&mut self) -> Result<(), GpuError> {
        self.steps_left -= 1;
        let Some(at) = self.draw() else { return Ok(()) };
        self.steps_done += 1;
        self.keyframes[at].steps += 1;
        let with_language = self.steps_done.is_multiple_of(self.config.language_every.max(1));
        if with_language {
            self.refresh_target(at)?;
        }
        let keyframe = &self.keyframes[at];
        let language = keyframe.generic.as_ref().filter(|_| with_language);
        let view = TrainingView {
            camera: &keyframe.working.camera,
            colour: Some(&keyframe.target),
            language: language.map(|generic| (&generic.camera, &generic.target)),
            exposure: keyframe.frame.exposure,
        };
        let (weights, rates) =
            (weights(&self.config), rates(&self.config, heat(self.steps_left, self.steps_earned)));
        self.renderer.step(&mut self.gaussians, &view, &weights, &rates)?;
        self.changed = true;
        if self.is_refined(at) {
            self.refine(at)?;
        }
        if self.steps_done.is_multiple_of(self.config.prune_every.max(1)) {
            self.prune()?;
        }
        Ok(())
    }

    /// Half of the time any keyframe, half of the time the one that had the fewest steps, of equals the
    /// newest: new ones catch up at once, and when the last have, all go on alike.
    fn draw(&mut self) -> Option<usize> {
        if self.rng.random_bool(0.5) && !self.keyframes.is_empty() {
            return Some(self.rng.random_range(0..self.keyframes.len()));
        }
        let all = self.keyframes.iter().enumerate();
        all.min_by_key(|(at, keyframe)| (keyframe.steps, Reverse(*at))).map(|(at, _)| at)
    }
}

/// What the rates of means and of the colour head are multiplied by: 1, and less over the last of the steps that were earned without
/// a rest, so that the map comes to rest as well (Adam's steps do not get smaller by themselves).
/// With the next keyframe's steps it is 1 again.
fn heat(steps_left: usize, steps_earned: usize) -> f32 {
    let cooling = COOLING * steps_earned as f32;
    if cooling > 0.0 { (steps_left as f32 / cooling).clamp(COLD, 1.0) } else { 1.0 }
}

fn weights(config: &MapperConfig) -> LossWeights {
    let loss = &config.loss;
    LossWeights {
        colour: loss.color,
        depth: loss.depth,
        language: loss.language,
        isotropic: loss.isotropic,
        tie: loss.scale_tie,
    }
}

fn rates(config: &MapperConfig, heat: f32) -> LearningRates {
    let rates = &config.rates;
    LearningRates {
        mean: rates.mean * heat,
        colour: HeadRates {
            rotation: rates.rotation * heat,
            log_scale: rates.scale * heat,
            opacity: rates.opacity * heat,
            feature: rates.color * heat,
        },
        language: HeadRates {
            rotation: rates.language_rotation,
            log_scale: rates.language_scale,
            opacity: rates.language_opacity,
            feature: rates.code,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_go_down_at_the_end_of_what_was_earned() {
        let heats: Vec<f32> = (0..40).rev().map(|left| heat(left, 40)).collect();
        assert!(heats[..30].iter().all(|heat| *heat == 1.0), "{heats:?}");
        assert!(heats[30..39].is_sorted_by(|a, b| a > b), "{heats:?}");
        assert_eq!(heats[39], COLD, "nothing stands still before its last step");
        assert!((heat(50, 400) - 0.5).abs() < 1e-6, "half of what there is to cool over");
        assert_eq!(heat(200, 400), 1.0);
        assert_eq!(heat(0, 0), 1.0);
    }
}
