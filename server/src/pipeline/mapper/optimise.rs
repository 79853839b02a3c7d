//! One optimiser step on one keyframe (paper §4.3): color and depth, language, or both.

use super::super::keyframes::{Keyframe, StepKind};
use super::super::live_map::LiveMap;
use super::super::tracker::TrackerConfig;
use super::config::MapperConfig;
use super::{pose_refinement, prune, turn};
use lexsplat_gpu::{
    Focus, Gpu, GpuError, HeadRates, LearningRates, LossWeights, Trainer, TrainingView, Youth,
};

/// No Gaussian grows beyond this many times the largest one that was inserted.
pub(super) const MAX_GROWTH: f32 = 2.0;

/// Takes one step from the map's budget. Returns whether the map changed: it does not while no keyframe has
/// what the step is to optimise.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(in super::super) fn step(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    gpu: &Gpu,
    config: &MapperConfig,
    tracker_config: &TrackerConfig,
) -> Result<bool, GpuError> {
    let Some((at, kind)) = turn::next(&live.keyframes, &live.steps, config) else {
        live.steps.drop_left();
        return Ok(false);
    };
    let number = live.steps.next_number();
    live.steps.take(kind);
    let keyframe = live.keyframes.at_mut(at);
    keyframe.visits.count(kind, number);
    if let Some(language) = keyframe.language.as_mut().filter(|_| kind.language) {
        language.refresh_target(gpu, live.online.as_ref())?;
    }
    let max_scale_metres = MAX_GROWTH * live.largest_scale_metres;
    let rates = learning_rates(config, live.steps.learning_rate_decay(), max_scale_metres);
    let view = training_view(keyframe, kind, number, config);
    trainer.step(&mut live.gaussians, &view, &loss_weights(config), &rates)?;
    if kind.color && pose_refinement::applies(&live.keyframes, at, tracker_config) {
        pose_refinement::refine(live, trainer, at, tracker_config)?;
    }
    if live.steps.is_due(config.prune_every) {
        prune::prune(live, trainer, config)?;
    }
    Ok(true)
}

fn training_view<'a>(
    keyframe: &'a Keyframe,
    kind: StepKind,
    number: usize,
    config: &MapperConfig,
) -> TrainingView<'a> {
    let language = keyframe.language.as_ref().filter(|_| kind.language);
    TrainingView {
        camera: &keyframe.training.camera,
        color: kind.color.then_some(&keyframe.target),
        language: language.map(|language| (&language.camera, &language.target)),
        exposure: keyframe.frame.exposure,
        focus: Some(Focus {
            mean_share: config.focus.mean_share,
            least_share: config.focus.least_share,
            turn: number as u32,
        }),
    }
}

pub(super) fn loss_weights(config: &MapperConfig) -> LossWeights {
    let loss = &config.loss;
    LossWeights {
        color: loss.color,
        depth: loss.depth,
        language: loss.language,
        isotropic: loss.isotropic,
        tie: loss.scale_tie,
    }
}

/// `decay` multiplies the rates of means and of the color head; language keeps its full rates.
pub(super) fn learning_rates(
    config: &MapperConfig,
    decay: f32,
    max_scale_metres: f32,
) -> LearningRates {
    let rates = &config.rates;
    LearningRates {
        mean: rates.mean * decay,
        color: HeadRates {
            rotation: rates.rotation * decay,
            log_scale: rates.scale * decay,
            opacity: rates.opacity * decay,
            feature: rates.color * decay,
        },
        language: HeadRates {
            rotation: rates.language_rotation,
            log_scale: rates.language_scale,
            opacity: rates.language_opacity,
            feature: rates.code,
        },
        youth: Youth { first_rate: rates.first, steps: rates.first_steps },
        max_scale_metres,
    }
}
