//! Poses and exposures of the newest keyframes, refined with the map they make.
//!
//! In: the gradients that a step found for its keyframe. Out: the keyframe moved by Adam's step of a
//! left perturbation [rho, theta] of `camera_from_world`, and of (a, b). Only estimated poses move;
//! the first keyframe's is what all others are relative to. Frames between keyframes move with
//! theirs.

use super::Mapper;
use lexsplat_gpu::align::se3;
use lexsplat_gpu::{GpuError, StepReport};
use nalgebra::{SVector, Vector6};

const FIRST_MOMENT: f64 = 0.9;
const SECOND_MOMENT: f64 = 0.999;
const EPSILON: f64 = 1e-15;

/// Adam's memory for [rho, theta, a, b].
#[derive(Clone, Debug, Default)]
pub(super) struct Moments {
    steps: i32,
    first: SVector<f64, 8>,
    second: SVector<f64, 8>,
}

impl Moments {
    /// The step down a gradient, of about one in each unknown.
    fn step(&mut self, gradient: &SVector<f64, 8>) -> SVector<f64, 8> {
        self.steps = self.steps.saturating_add(1);
        self.first = self.first * FIRST_MOMENT + gradient * (1.0 - FIRST_MOMENT);
        let squared = gradient.component_mul(gradient);
        self.second = self.second * SECOND_MOMENT + squared * (1.0 - SECOND_MOMENT);
        let first = self.first / (1.0 - FIRST_MOMENT.powi(self.steps));
        let second = self.second / (1.0 - SECOND_MOMENT.powi(self.steps));
        first.zip_map(&second, |m, v| -m / (v.sqrt() + EPSILON))
    }
}

impl Mapper {
    /// Whether the keyframe's pose moves with the map.
    pub(super) fn is_refined(&self, at: usize) -> bool {
        let newest = self.keyframes.len().saturating_sub(self.tracker_config.refine_keyframes);
        at > 0 && at >= newest && self.keyframes[at].is_estimated
    }

    /// Moves a keyframe by what the step on it found. Waits for the step.
    pub(super) fn refine(&mut self, at: usize) -> Result<(), GpuError> {
        let StepReport { pose_gradient, exposure_gradient, .. } =
            self.renderer.last_report(&mut self.gaussians)?;
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
        for (exposure, step) in keyframe.exposure.iter_mut().zip([step[6], step[7]]) {
            *exposure += (rates.refine_exposure * step) as f32;
        }
        let (frame, [a, b]) = (keyframe.frame, keyframe.exposure.map(f64::from));
        let exposure = [-a, -b * (-a).exp()];
        self.tracker.correct_keyframe(frame.sequence, frame.world_from_camera, exposure);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_go_down_and_grow_small_at_the_bottom() {
        let bottom = SVector::<f64, 8>::from_fn(|i, _| 0.01 * i as f64);
        let mut at = SVector::<f64, 8>::repeat(0.05);
        let mut moments = Moments::default();
        let first = moments.clone().step(&(at - bottom));
        assert!(first.iter().zip((at - bottom).iter()).all(|(s, g)| *s == 0.0 || s * g < 0.0));
        assert!(first.amax() <= 1.0 + 1e-6, "a step is of about one");
        for _ in 0..300 {
            at += moments.step(&(at - bottom)) * 1e-3;
        }
        assert!((at - bottom).amax() < 5e-3, "{}", (at - bottom).amax());
    }
}
