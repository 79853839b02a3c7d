//! The paper's tracker (§5, "100 iterations"): Adam on the pose, each step on a picture of the map.
//!
//! In: a frame at working size, the map, where the frame before was taken. Out: a [`Candidate`] that is
//! always believed, since the paper's is. Kept to be compared with: it renders the map up to a hundred
//! times for a frame where the default aligns pictures that it has. It must not change the map.

use super::super::working::Working;
use super::adam::Moments;
use super::align::Candidate;
use super::{PhotometricConfig, Scene, inverse_exposure};
use lexsplat_gpu::align::se3;
use lexsplat_gpu::{Camera, ColorTarget, Gpu, GpuError, LossWeights, StepReport};
use nalgebra::{Isometry3, SVector, Vector6};

/// Where the frame was taken, from (`world_from_camera`, exposure) of the frame before.
///
/// # Errors
/// Those of the device.
pub(super) fn track(
    gpu: &Gpu,
    scene: &mut Scene<'_>,
    working: &Working,
    (start, exposure): (Isometry3<f64>, [f64; 2]),
    config: &PhotometricConfig,
) -> Result<Candidate, GpuError> {
    let size = (working.camera.width, working.camera.height);
    let target = ColorTarget::new(gpu, size, &working.rgb, &working.depth_metres)?;
    let weights = LossWeights {
        color: config.color,
        depth: config.depth,
        language: 0.0,
        isotropic: 0.0,
        tie: 0.0,
    };
    let mut camera_from_world = start.inverse();
    // The other way round: the frame shows exp(a) of the map's color + b.
    let mut exposure = inverse_exposure(exposure);
    let mut moments = Moments::default();
    for _ in 0..config.iterations {
        let camera =
            Camera { camera_from_world: camera_from_world.cast(), ..working.camera.clone() };
        let view = (&camera, &target);
        let StepReport { pose_gradient, exposure_gradient, .. } = scene.trainer.look(
            scene.gaussians,
            view,
            exposure.map(|value| value as f32),
            &weights,
        )?;
        let numbers = pose_gradient.iter().chain(&exposure_gradient).copied().map(f64::from);
        let gradient = SVector::<f64, 8>::from_iterator(numbers);
        if !gradient.iter().all(|value| value.is_finite()) {
            break;
        }
        let step = moments.step(&gradient);
        let rate = |i: usize| if i < 3 { config.metres } else { config.radians };
        let tau = Vector6::from_fn(|i, _| step[i] * rate(i));
        camera_from_world = se3::exp(&tau) * camera_from_world;
        camera_from_world.rotation.renormalize();
        for (value, step) in exposure.iter_mut().zip([step[6], step[7]]) {
            *value += config.exposure * step;
        }
        if tau.norm() < config.converged {
            break;
        }
    }
    let found = Candidate::given(camera_from_world.inverse());
    Ok(Candidate { exposure: inverse_exposure(exposure), ..found })
}
