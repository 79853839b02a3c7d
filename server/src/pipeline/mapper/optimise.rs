//! One optimiser step on one view, drawn from the window or from all keyframes.

use super::{Mapper, MapperConfig};
use lexsplat_gpu::{GpuError, HeadRates, LearningRates, LossWeights, TrainingView};
use rand::Rng;

impl Mapper {
    /// Takes one of the steps that are left.
    pub(super) fn optimise_once(&mut self) -> Result<(), GpuError> {
        self.steps_left -= 1;
        let Some(at) = self.draw() else { return Ok(()) };
        self.steps_done += 1;
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
            exposure: keyframe.exposure,
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

    /// Half of the time one of the newest keyframes, half of the time any.
    fn draw(&mut self) -> Option<usize> {
        let count = self.keyframes.len();
        if count == 0 {
            return None;
        }
        let first = if self.rng.random_bool(0.5) {
            count.saturating_sub(self.config.window.max(1))
        } else {
            0
        };
        Some(self.rng.random_range(first..count))
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
