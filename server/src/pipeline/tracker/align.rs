//! The device's part of tracking: the frame, the picture it is compared with, and the alignment.
//!
//! In: frames at working size and starts ([`Start`]). Out: [`Candidate`]s, which nobody need believe.

use super::super::frame::PoseHint;
use super::super::working::Working;
use super::judge::Evidence;
use super::{Scene, TrackerConfig};
use lexsplat_gpu::align::Prior;
use lexsplat_gpu::kernel::Recorder;
use lexsplat_gpu::pyramid;
use lexsplat_gpu::{
    AlignSettings, Aligned, Aligner, Camera, Estimate, Gpu, GpuError, Pyramid, Pyramids, Schedule,
};
use nalgebra::{Isometry3, Matrix3, Matrix6};

/// A robot that knows its pose better than this, metres and radians, is not believed to.
const FINEST_HINT: f64 = 1e-4;
/// A wide start may be this much farther from the surface than a narrow one.
const WIDE_GATE: f64 = 3.0;

/// Where to begin.
#[derive(Clone, Debug)]
pub(super) struct Start {
    /// `world_from_camera`.
    pub pose: Isometry3<f64>,
    /// (a, b), see [`Candidate`].
    pub exposure: [f64; 2],
    /// Whether the pose may be far off.
    pub wide: bool,
    /// Information of a left perturbation of `pose`, if it is known how good it is.
    pub prior: Option<Matrix6<f64>>,
}

/// A pose, and what speaks for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// The pose.
    pub world_from_camera: Isometry3<f64>,
    /// (a, b): the map's intensity = exp(a) of the frame's + b.
    pub exposure: [f64; 2],
    /// What speaks for it.
    pub evidence: Evidence,
}

/// Kernels, the live frame, its reference and the frame before.
pub(super) struct Front {
    gpu: Gpu,
    config: TrackerConfig,
    camera: Camera,
    levels: usize,
    pyramids: Pyramids,
    aligner: Aligner,
    reference: Pyramid,
    live: Pyramid,
    last: Pyramid,
    /// Where the frame in `last` was taken.
    last_found: Option<Candidate>,
}

impl Start {
    /// What the robot thinks, if it says how good that is.
    pub fn of_hint(hint: &PoseHint, exposure: [f64; 2]) -> Option<Self> {
        let covariance = hint.covariance? + Matrix6::identity() * FINEST_HINT.powi(2);
        let information = covariance.cholesky()?.inverse();
        Some(Self { pose: hint.world_from_camera, exposure, wide: false, prior: Some(information) })
    }

    /// A place that the camera may be at, or not.
    pub fn anywhere(pose: Isometry3<f64>) -> Self {
        Self { pose, exposure: [0.0; 2], wide: true, prior: None }
    }
}

impl Candidate {
    /// A pose that is not in doubt.
    pub fn given(world_from_camera: Isometry3<f64>) -> Self {
        let evidence =
            Evidence { overlap: 1.0, surface: 1.0, intensity: 1.0, conditioning: 1.0 };
        Self { world_from_camera, exposure: [0.0; 2], evidence }
    }
}

impl Front {
    /// For frames of a camera; `None` if they are too small to tell a pose.
    ///
    /// # Errors
    /// Those of the device.
    pub fn new(
        gpu: &Gpu,
        camera: &Camera,
        config: &TrackerConfig,
    ) -> Result<Option<Self>, GpuError> {
        let wanted = config.steps.len().max(config.wide_steps.len()).max(1);
        let Some(levels) = (1..=wanted).rev().find(|n| pyramid::cameras(camera, *n).is_ok()) else {
            return Ok(None);
        };
        let pyramids = Pyramids::new(gpu)?;
        let allocate = || pyramids.allocate(camera, levels);
        let (reference, live, last) = (allocate()?, allocate()?, allocate()?);
        Ok(Some(Self {
            gpu: gpu.clone(),
            config: config.clone(),
            camera: camera.clone(),
            levels,
            aligner: Aligner::new(gpu)?,
            pyramids,
            reference,
            live,
            last,
            last_found: None,
        }))
    }

    /// A new frame.
    pub fn see(&mut self, working: &Working) -> Result<(), GpuError> {
        self.pyramids.fill(&mut self.live, &working.rgb, &working.depth_metres)
    }

    /// The frame was tracked: it is the frame before from now on.
    pub fn keep(&mut self, found: &Candidate) {
        std::mem::swap(&mut self.live, &mut self.last);
        self.last_found = Some(*found);
    }

    /// Aligns the frame with the map.
    pub fn align_with_map(
        &mut self,
        scene: &mut Scene<'_>,
        start: &Start,
    ) -> Result<Candidate, GpuError> {
        let mut found = self.align_from(scene, (start.pose, start), start.wide)?;
        let moved = start.pose.inverse() * found.world_from_camera;
        let is_far = moved.translation.vector.norm() > self.config.rerender_metres
            || moved.rotation.angle() > self.config.rerender_radians;
        if is_far && found.evidence.overlap >= self.config.min_overlap {
            let nearer = Start { exposure: found.exposure, ..start.clone() };
            found = self.align_from(scene, (found.world_from_camera, &nearer), false)?;
        }
        Ok(found)
    }

    /// Renders the map at a pose and aligns the frame with that.
    fn align_from(
        &mut self,
        scene: &mut Scene<'_>,
        (world_from_reference, start): (Isometry3<f64>, &Start),
        wide: bool,
    ) -> Result<Candidate, GpuError> {
        let camera = Camera {
            camera_from_world: world_from_reference.inverse().cast(),
            ..self.camera.clone()
        };
        let drawn = scene.renderer.draw_colour(scene.gaussians, &camera)?;
        let drawn = drawn.expect("the tracker does not ask an empty map");
        let mut recorder = Recorder::new(&self.gpu)?;
        let image = (drawn.image, drawn.pixels);
        self.pyramids.fill_rendered(&mut recorder, &self.reference, image)?;
        recorder.submit();
        let prior = start.prior.as_ref().map(|information| {
            let reference_from_world = world_from_reference.inverse();
            prior(&reference_from_world, &start.pose, information, self.config.correlated_pixels)
        });
        let estimate = Estimate { exposure: start.exposure, ..Estimate::default() };
        let schedule = self.schedule(wide, prior);
        let aligned = self.aligner.align(&self.reference, &self.live, &estimate, &schedule)?;
        Ok(candidate(&world_from_reference, &aligned))
    }

    /// Aligns the frame with the one before, if there is one.
    pub fn align_with_last(&mut self, start: &Start) -> Result<Option<Candidate>, GpuError> {
        let Some(last) = self.last_found else { return Ok(None) };
        let reference_from_live = last.world_from_camera.inverse() * start.pose;
        let estimate = Estimate { reference_from_live, exposure: [0.0; 2] };
        let schedule = self.schedule(false, None);
        let aligned = self.aligner.align(&self.last, &self.live, &estimate, &schedule)?;
        let mut found = candidate(&last.world_from_camera, &aligned);
        // exp(a) (exp(c) I + d) + b
        let ([a, b], [c, d]) = (last.exposure, found.exposure);
        found.exposure = [a + c, a.exp() * d + b];
        Ok(Some(found))
    }

    fn schedule(&self, wide: bool, prior: Option<Prior>) -> Schedule {
        let config = &self.config;
        let mut steps = if wide { config.wide_steps.clone() } else { config.steps.clone() };
        steps.truncate(self.levels);
        let settings = AlignSettings::default();
        let depth_gate = settings.depth_gate * if wide { WIDE_GATE } else { 1.0 };
        let settings = AlignSettings {
            photometric_weight: config.photometric_weight,
            geometric_weight: config.geometric_weight,
            depth_gate,
            ..settings
        };
        Schedule { steps, settings, with_exposure: config.exposure, prior, ..Schedule::default() }
    }
}

fn candidate(world_from_reference: &Isometry3<f64>, aligned: &Aligned) -> Candidate {
    let mut world_from_camera = world_from_reference * aligned.estimate.reference_from_live;
    world_from_camera.rotation.renormalize();
    Candidate {
        world_from_camera,
        exposure: aligned.estimate.exposure,
        evidence: Evidence::of(aligned),
    }
}

/// What is known of `world_from_camera`, seen from the reference: a left perturbation tau of it is
/// Ad tau there, Ad being `reference_from_world`'s adjoint.
fn prior(
    reference_from_world: &Isometry3<f64>,
    world_from_camera: &Isometry3<f64>,
    information: &Matrix6<f64>,
    pixels: f64,
) -> Prior {
    let inverse = adjoint(&reference_from_world.inverse());
    Prior {
        information: inverse.transpose() * information * inverse * pixels,
        reference_from_live: reference_from_world * world_from_camera,
    }
}

/// [R, [t]x R; 0, R]: T Exp(tau) = Exp(Ad tau) T for tau = [rho, theta].
fn adjoint(motion: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation: Matrix3<f64> = motion.rotation.to_rotation_matrix().into_inner();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    let cross = motion.translation.vector.cross_matrix();
    adjoint.fixed_view_mut::<3, 3>(0, 3).copy_from(&(cross * rotation));
    adjoint
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::align::se3;
    use nalgebra::Vector6;

    #[test]
    fn the_adjoint_carries_a_perturbation_to_the_other_side() {
        let motion = se3::exp(&Vector6::new(0.4, -0.2, 0.3, 0.5, -0.8, 0.2));
        let tau = Vector6::new(0.1, 0.2, -0.1, 0.05, -0.1, 0.2);
        let left = motion * se3::exp(&tau);
        let right = |tau: Vector6<f64>| se3::exp(&tau) * motion;
        let off = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
            (a.to_homogeneous() - b.to_homogeneous()).norm()
        };
        assert!(off(&left, &right(adjoint(&motion) * tau)) < 1e-9);
        assert!(off(&left, &right(tau)) > 0.01, "it is not the same perturbation");
    }

    #[test]
    fn a_prior_costs_the_same_seen_from_anywhere() {
        let information =
            Matrix6::from_diagonal(&Vector6::new(1.0, 4.0, 9.0, 100.0, 400.0, 900.0));
        let expected = se3::exp(&Vector6::new(0.4, -0.2, 0.3, 0.5, -0.8, 0.2));
        let tau = Vector6::new(0.01, 0.02, -0.01, 0.005, -0.01, 0.02);
        let there = se3::exp(&tau) * expected;
        let cost = 0.5 * tau.dot(&(information * tau));
        let reference = se3::exp(&Vector6::new(-0.3, 0.1, 0.9, 0.1, 0.7, -0.2));
        let seen = prior(&reference, &expected, &information, 1.0);
        let found = seen.cost(&(reference * there));
        assert!((found - cost).abs() < 1e-6 * cost, "{found} {cost}");
        assert!((seen.cost(&(reference * expected))).abs() < 1e-12);
        assert!((seen.cost(&there) - cost).abs() > 0.1 * cost, "the reference matters");
    }
}
