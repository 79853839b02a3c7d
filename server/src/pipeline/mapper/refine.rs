//! Poses and exposures of the newest keyframes, refined with the map they make.
//!
//! In: the gradients that a step found for its keyframe. Out: the keyframe moved by Adam's step of a
//! left perturbation [rho, theta] of `camera_from_world`, and of (a, b). Only estimated poses move;
//! the first keyframe's is what all others are relative to. Frames between keyframes move with
//! theirs.

use super::super::tracker::inverse_exposure;
use super::Mapper;
use lexsplat_gpu::align::se3;
use lexsplat_gpu::{GpuError, StepReport};
use nalgebra::{SVector, Vector6};

impl Mapper {
    /// Whether the keyframe's pose moves with the map.
    pub(super) fn is_refined(&self, at: usize) -> bool {
        let newest = self.keyframes.len().saturating_sub(self.tracker_config.refine_keyframes);
        at > 0 && at >= newest && self.keyframes[at].is_estimated
    }

    /// Moves a keyframe by what the step on it found. Waits for the step.
    pub(super) fn refine(&mut self, at: usize) -> Result<(), GpuError> {
        let StepReport { pose_gradient, exposure_gradient, .. } =
            self.trainer.last_report(&mut self.gaussians)?;
        let numbers = pose_gradient.iter().chain(&exposure_gradient).copied().map(f64::from);
        let gradient = SVector::<f64, 8>::from_iterator(numbers);
        if !gradient.iter().all(|value| value.is_finite()) {
            return Ok(());
        }
        let rates = &self.tracker_config;
        let keyframe = &mut self.keyframes[at];
        let step = keyframe.moments.step(&gradient);
        let [metres, radians] = [rates.refine_metres, rates.refine_radians];
        let tau = Vector6::from_fn(|i, _| step[i] * if i < 3 { metres } else { radians });
        keyframe.place(&(keyframe.frame.world_from_camera * se3::exp(&tau).inverse()));
        for (exposure, step) in keyframe.frame.exposure.iter_mut().zip([step[6], step[7]]) {
            *exposure += (rates.refine_exposure * step) as f32;
        }
        let frame = keyframe.frame;
        let exposure = inverse_exposure(keyframe.frame.exposure.map(f64::from));
        self.tracker.correct_keyframe(frame.sequence, frame.world_from_camera, exposure);
        Ok(())
    }
}
