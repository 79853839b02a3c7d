//! Refines poses and exposures of the newest keyframes together with the map.
//!
//! In: the gradients that an optimiser step found for its keyframe. Out: the keyframe moved by Adam's step
//! of a left perturbation [rho, theta] of `camera_from_world` and of the exposure (a, b). Only estimated
//! poses are refined. The first keyframe is the origin of all others and stays.

use super::super::keyframes::KeyframeStore;
use super::super::live_map::LiveMap;
use super::super::tracker::TrackerConfig;
use lexsplat_gpu::align::se3;
use lexsplat_gpu::{GpuError, StepReport, Trainer};
use nalgebra::{SVector, Vector6};

/// Whether the pose of the keyframe at this index is refined.
pub(super) fn applies(keyframes: &KeyframeStore, at: usize, config: &TrackerConfig) -> bool {
    let oldest_refined = keyframes.len().saturating_sub(config.refine_keyframes);
    at > 0 && at >= oldest_refined && keyframes.at(at).is_estimated
}

/// Moves a keyframe along the gradient of the step that was just taken on it. Waits for that step.
pub(super) fn refine(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    at: usize,
    config: &TrackerConfig,
) -> Result<(), GpuError> {
    let StepReport { pose_gradient, exposure_gradient, .. } =
        trainer.last_report(&mut live.gaussians)?;
    let numbers = pose_gradient.iter().chain(&exposure_gradient).copied().map(f64::from);
    let gradient = SVector::<f64, 8>::from_iterator(numbers);
    if !gradient.iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    let keyframe = live.keyframes.at_mut(at);
    let step = keyframe.pose_adam.step(&gradient);
    let [metres, radians] = [config.refine_metres, config.refine_radians];
    let tau = Vector6::from_fn(|i, _| step[i] * if i < 3 { metres } else { radians });
    keyframe.set_pose(&(keyframe.frame.world_from_camera * se3::exp(&tau).inverse()));
    let [a, b] = keyframe.frame.exposure;
    let moved = [step[6], step[7]].map(|step| (config.refine_exposure * step) as f32);
    keyframe.set_exposure([a + moved[0], b + moved[1]]);
    Ok(())
}
