//! Improves the map at the size at which keyframes were received, while nothing else is to be done.
//!
//! In: the next window of a keyframe. Out: Gaussians for detail that the map lacks, at the first visit of a
//! window, and one optimiser step on it. A step costs as much as an ordinary one, whatever the camera's size.
//! Poses, exposures and language stay as they are.

use super::super::live_map::{LiveMap, Window};
use super::config::MapperConfig;
use super::{insert, optimise, prune};
use lexsplat_gpu::{ColorTarget, Gpu, GpuError, Trainer, TrainingView};

/// Refines the map by one window, and waits for the device, so that a frame finds at most this step in its
/// way. Returns whether the map changed.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(in super::super) fn step(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    gpu: &Gpu,
    config: &MapperConfig,
) -> Result<bool, GpuError> {
    let LiveMap { keyframes, refinement, rng, .. } = live;
    let windows = keyframes.iter().flat_map(|keyframe| {
        let sequence = keyframe.frame.sequence;
        (0..keyframe.windows()).map(move |index| Window { sequence, index })
    });
    let Some(window) = refinement.next(windows, rng) else { return Ok(false) };
    let Some(at) = keyframes.find(window.sequence) else {
        // It was forgotten during the sweep.
        refinement.count(f32::NAN, config.refine_sweeps);
        return Ok(false);
    };
    if !refinement.is_detailed(window) {
        trainer.settle(&mut live.gaussians)?;
        insert::insert_detail(live, trainer, at, window.index, config)?;
    }
    let keyframe = live.keyframes.at(at);
    let picture = keyframe.window(window.index);
    let target = if keyframe.windows() > 1 {
        let [width, height] = [picture.camera.width, picture.camera.height];
        ColorTarget::new(gpu, width, height, &picture.rgb, &picture.depth_metres)?
    } else {
        keyframe.target.clone()
    };
    let view = TrainingView {
        camera: &picture.camera,
        color: Some(&target),
        language: None,
        exposure: keyframe.frame.exposure,
        focus: None,
    };
    let max_scale_metres = optimise::MAX_GROWTH * live.largest_scale_metres;
    let rate = live.refinement.rate(config.refine_sweeps);
    let rates = optimise::learning_rates(config, rate, max_scale_metres);
    trainer.step(&mut live.gaussians, &view, &optimise::loss_weights(config), &rates)?;
    let losses = trainer.last_report(&mut live.gaussians)?.losses;
    live.refinement.count(losses.color + losses.depth, config.refine_sweeps);
    if live.refinement.is_due(config.prune_every) {
        prune::prune(live, trainer, config)?;
    }
    Ok(true)
}
