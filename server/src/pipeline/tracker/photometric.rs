//! The paper's tracker (§5, "100 iterations"): Adam on the pose, with a rendered image for each step.
//!
//! In: a downsampled frame, the map, and the pose and exposure of the frame before. Out: a
//! [`PoseCandidate`] that is always accepted, as in the paper. It is kept for comparison: it renders the map
//! up to a hundred times for a frame, where the default method aligns images that exist already.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::exposure;
use super::super::pose_adam::PoseAdam;
use super::candidate::PoseCandidate;
use super::config::PhotometricConfig;
use super::scene::Scene;
use lexsplat_gpu::align::se3;
use lexsplat_gpu::{Camera, ColorTarget, Gpu, GpuError, LossWeights, StepReport};
use nalgebra::{Isometry3, SVector, Vector6};

/// Estimates the pose of a frame, starting from the frame before.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(super) fn track(
    gpu: &Gpu,
    scene: &mut Scene<'_>,
    frame: &DownsampledFrame,
    start: &Isometry3<f64>,
    start_exposure: [f64; 2],
    config: &PhotometricConfig,
) -> Result<PoseCandidate, GpuError> {
    let Camera { width, height, .. } = frame.camera;
    let target = ColorTarget::new(gpu, width, height, &frame.rgb, &frame.depth_metres)?;
    let weights = LossWeights {
        color: config.color,
        depth: config.depth,
        language: 0.0,
        isotropic: 0.0,
        tie: 0.0,
    };
    let mut camera_from_world = start.inverse();
    // The frame's color is exp(a) times the map's plus b, the inverse of a candidate's exposure.
    let mut color_exposure = exposure::inverse(start_exposure);
    let mut adam = PoseAdam::default();
    for _ in 0..config.iterations {
        let camera = Camera { camera_from_world: camera_from_world.cast(), ..frame.camera.clone() };
        let StepReport { pose_gradient, exposure_gradient, .. } = scene.trainer.look(
            scene.gaussians,
            &camera,
            &target,
            color_exposure.map(|value| value as f32),
            &weights,
        )?;
        let numbers = pose_gradient.iter().chain(&exposure_gradient).copied().map(f64::from);
        let gradient = SVector::<f64, 8>::from_iterator(numbers);
        if !gradient.iter().all(|value| value.is_finite()) {
            break;
        }
        let step = adam.step(&gradient);
        let rate = |i: usize| if i < 3 { config.metres } else { config.radians };
        let tau = Vector6::from_fn(|i, _| step[i] * rate(i));
        camera_from_world = se3::exp(&tau) * camera_from_world;
        camera_from_world.rotation.renormalize();
        for (value, step) in color_exposure.iter_mut().zip([step[6], step[7]]) {
            *value += config.exposure * step;
        }
        if tau.norm() < config.converged {
            break;
        }
    }
    let found = PoseCandidate::given(camera_from_world.inverse());
    Ok(PoseCandidate { exposure: exposure::inverse(color_exposure), ..found })
}
