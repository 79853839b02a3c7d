//! One optimiser step on one view: the one that had the fewest so far, or any.

use super::{Mapper, MapperConfig};
use lexsplat_gpu::{GpuError, HeadRates, LearningRates, LossWeights, TrainingView};
use rand::Rng;
use std::cmp::Reverse;

impl Mapper {
    /// Takes one of the steps that are left.
    pub(super) fn optimise_once(&mut self) -> Result<(), GpuError> {
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
        let (weights, rates) = (weights(&self.config), rates(&self.config));
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

fn rates(config: &MapperConfig) -> LearningRates {
    let rates = &config.rates;
    LearningRates {
        mean: rates.mean,
        colour: HeadRates {
            rotation: rates.rotation,
            log_scale: rates.scale,
            opacity: rates.opacity,
            feature: rates.color,
        },
        language: HeadRates {
            rotation: rates.language_rotation,
            log_scale: rates.language_scale,
            opacity: rates.language_opacity,
            feature: rates.code,
        },
    }
}
