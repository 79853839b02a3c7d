//! One optimiser step on one view: the one that had the fewest so far, or any.

use super::steps::Step;
use super::{Mapper, MapperConfig};
use crate::telemetry::{MAPPING_SECONDS, timed};
use lexsplat_gpu::{GpuError, HeadRates, LearningRates, LossWeights, TrainingView};
use rand::Rng;
use rand::seq::IteratorRandom as _;
use std::cmp::Reverse;

impl Mapper {
    /// Takes one of the steps that are left.
    pub(super) fn optimise_once(&mut self) -> Result<(), GpuError> {
        timed(MAPPING_SECONDS, || self.step())
    }

    fn step(&mut self) -> Result<(), GpuError> {
        let Some(Step { color, language }) = self.steps.take() else { return Ok(()) };
        let Some(at) = self.draw(language) else { return Ok(()) };
        self.keyframes[at].steps += 1;
        if language {
            self.refresh_target(at)?;
        }
        let keyframe = &self.keyframes[at];
        let generic = keyframe.generic.as_ref().filter(|_| language);
        let view = TrainingView {
            camera: &keyframe.working.camera,
            color: color.then_some(&keyframe.target),
            language: generic.map(|generic| (&generic.camera, &generic.target)),
            exposure: keyframe.frame.exposure,
        };
        let (weights, rates) = (weights(&self.config), rates(&self.config, self.steps.heat()));
        self.trainer.step(&mut self.gaussians, &view, &weights, &rates)?;
        self.changed = true;
        if color && self.is_refined(at) {
            self.refine(at)?;
        }
        if self.steps.is_time(self.config.prune_every) {
            self.prune()?;
        }
        Ok(())
    }

    /// Half of the time any keyframe, half of the time the one that had the fewest steps, of equals the
    /// newest: new ones catch up at once, and when the last have, all go on alike. Where language is to be
    /// learned, of those that have theirs.
    fn draw(&mut self, with_language: bool) -> Option<usize> {
        let all = self.keyframes.iter().enumerate();
        let all = all.filter(|(_, keyframe)| !with_language || keyframe.generic.is_some());
        if self.rng.random_bool(0.5) {
            return all.choose(&mut self.rng).map(|(at, _)| at);
        }
        all.min_by_key(|(at, keyframe)| (keyframe.steps, Reverse(*at))).map(|(at, _)| at)
    }
}

fn weights(config: &MapperConfig) -> LossWeights {
    let loss = &config.loss;
    LossWeights {
        color: loss.color,
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
        color: HeadRates {
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
