//! The device's part of tracking: the frame, the pictures it is compared with, and the alignment.
//!
//! In: frames at working size, starts ([`Start`]) and keyframes. Out: [`Candidate`]s, which nobody
//! need believe.

use super::super::frame::PoseHint;
use super::super::working::Working;
use super::joint::{self, Reference, adjoint};
use super::judge::Evidence;
use super::places::Place;
use super::{Scene, TrackerConfig};
use lexsplat_gpu::Recorder;
use lexsplat_gpu::align::Prior;
use lexsplat_gpu::pyramid;
use lexsplat_gpu::{
    AlignSettings, Aligner, Camera, Estimate, Gpu, GpuError, Pyramid, Pyramids, Schedule,
};
use nalgebra::{Isometry3, Matrix6};

/// A robot that knows its pose better than this, metres and radians, is not believed to.
const FINEST_HINT: f64 = 1e-4;
/// A wide start may be this much farther from the surface than a narrow one, turned away from it, and its
/// residuals pull with their size for so much longer.
const WIDE: f64 = 5.0;
/// Narrow alignments after a wide one, at most; and when the last of them has settled, metres and radians.
const MOST_NARROW: usize = 4;
const SETTLED: f64 = 1e-3;

/// At least one of so many pixels is compared: what [`AlignSettings`] takes.
const MOST_STRIDE: usize = 64;

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
    /// Whether it was searched for far from where the camera should be.
    pub jumped: bool,
}

/// Kernels, the live frame, what it is compared with, and the frame before.
pub(super) struct Front {
    gpu: Gpu,
    config: TrackerConfig,
    camera: Camera,
    levels: usize,
    pyramids: Pyramids,
    aligner: Aligner,
    rendered: Pyramid,
    live: Pyramid,
    last: Pyramid,
    /// Where the frame in `last` was taken.
    last_found: Option<Candidate>,
    /// Keyframes' own pictures, by their sequence.
    pictures: Vec<(u64, Pyramid)>,
}

impl Start {
    /// What the robot thinks, if it says how good that is.
    pub fn of_hint(hint: &PoseHint, exposure: [f64; 2]) -> Option<Self> {
        let covariance = hint.covariance? + Matrix6::identity() * FINEST_HINT.powi(2);
        let information = covariance.cholesky()?.inverse();
        Some(Self { pose: hint.world_from_camera, exposure, wide: false, prior: Some(information) })
    }

    /// A place that the camera may be at, or not.
    pub fn anywhere(place: &Place) -> Self {
        let (pose, exposure) = (place.world_from_camera, place.exposure);
        Self { pose, exposure, wide: true, prior: None }
    }
}

impl Candidate {
    /// A pose that is not in doubt.
    pub fn given(world_from_camera: Isometry3<f64>) -> Self {
        let evidence = Evidence { overlap: 1.0, surface: 1.0, intensity: 1.0, conditioning: 1.0 };
        Self { world_from_camera, exposure: [0.0; 2], evidence, jumped: false }
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
        let fits = |levels: &usize| pyramid::cameras(camera, *levels).is_ok();
        let Some(levels) = (1..=wanted).rev().find(fits) else { return Ok(None) };
        let pyramids = Pyramids::new(gpu)?;
        let allocate = || pyramids.allocate(camera, levels);
        let (rendered, live, last) = (allocate()?, allocate()?, allocate()?);
        Ok(Some(Self {
            gpu: gpu.clone(),
            config: config.clone(),
            camera: camera.clone(),
            levels,
            aligner: Aligner::new(gpu)?,
            pyramids,
            rendered,
            live,
            last,
            last_found: None,
            pictures: Vec::new(),
        }))
    }

    /// A new frame.
    ///
    /// # Errors
    /// Those of the device.
    pub fn see(&mut self, working: &Working) -> Result<(), GpuError> {
        self.pyramids.fill(&mut self.live, &working.rgb, &working.depth_metres)
    }

    /// The frame was tracked: it is the frame before from now on.
    pub fn keep(&mut self, found: &Candidate) {
        std::mem::swap(&mut self.live, &mut self.last);
        self.last_found = Some(*found);
    }

    /// Aligns the frame with keyframes' own pictures, and with the map rendered at the start if that
    /// has a weight or there are no keyframes.
    ///
    /// # Errors
    /// Those of the device.
    pub fn align_with_map(
        &mut self,
        scene: &mut Scene<'_>,
        start: &Start,
        keyframes: &[&Place],
    ) -> Result<Candidate, GpuError> {
        self.upload(keyframes)?;
        let mut found = self.align_from(scene, (start.pose, start), start.wide, keyframes)?;
        let way = |from: &Isometry3<f64>, to: &Isometry3<f64>| {
            let moved = from.inverse() * to;
            (moved.translation.vector.norm(), moved.rotation.angle())
        };
        let (metres, radians) = way(&start.pose, &found.world_from_camera);
        let is_far = metres > self.config.rerender_metres || radians > self.config.rerender_radians;
        // What a wide start let in is not what a pose should be judged by: until it has settled.
        let most = if start.wide { MOST_NARROW } else { usize::from(is_far) };
        for _ in 0..most {
            if found.evidence.overlap < self.config.min_overlap {
                break;
            }
            let nearer = Start { exposure: found.exposure, ..start.clone() };
            let from = found.world_from_camera;
            found = self.align_from(scene, (from, &nearer), false, keyframes)?;
            let (metres, radians) = way(&from, &found.world_from_camera);
            if metres < SETTLED && radians < SETTLED {
                break;
            }
        }
        Ok(found)
    }

    /// Puts the pictures of these keyframes on the device, in place of those of others.
    fn upload(&mut self, keyframes: &[&Place]) -> Result<(), GpuError> {
        let is_wanted =
            |sequence: u64| keyframes.iter().any(|keyframe| keyframe.sequence == sequence);
        let (kept, mut spare): (Vec<_>, Vec<_>) =
            self.pictures.drain(..).partition(|(sequence, _)| is_wanted(*sequence));
        self.pictures = kept;
        for keyframe in keyframes {
            if self.pictures.iter().any(|(sequence, _)| *sequence == keyframe.sequence) {
                continue;
            }
            let mut picture = match spare.pop() {
                Some((_, picture)) => picture,
                None => self.pyramids.allocate(&self.camera, self.levels)?,
            };
            let working = &keyframe.working;
            self.pyramids.fill(&mut picture, &working.rgb, &working.depth_metres)?;
            self.pictures.push((keyframe.sequence, picture));
        }
        Ok(())
    }

    /// Renders the map at a pose and aligns the frame with that and the keyframes.
    fn align_from(
        &mut self,
        scene: &mut Scene<'_>,
        (world_from_base, start): (Isometry3<f64>, &Start),
        wide: bool,
        keyframes: &[&Place],
    ) -> Result<Candidate, GpuError> {
        let mut references = Vec::new();
        let map_weight = if keyframes.is_empty() { 1.0 } else { self.config.map_weight };
        if map_weight > 0.0 {
            self.render(scene, &world_from_base)?;
            references.push(Reference {
                pyramid: &self.rendered,
                world_from_reference: world_from_base,
                exposure: [0.0; 2],
                weight: map_weight,
            });
        }
        for keyframe in keyframes {
            let picture = self.pictures.iter().find(|(sequence, _)| *sequence == keyframe.sequence);
            let (_, pyramid) = picture.expect("it was uploaded");
            references.push(Reference {
                pyramid,
                world_from_reference: keyframe.world_from_camera,
                exposure: keyframe.exposure,
                weight: 1.0,
            });
        }
        let prior = start.prior.as_ref().map(|information| {
            let base_from_world = world_from_base.inverse();
            // Of the pixels that tell one thing, only some are compared.
            let pixels = self.config.correlated_pixels / f64::from(self.stride());
            prior(&base_from_world, &start.pose, information, pixels)
        });
        let schedule = self.schedule(wide, prior);
        let estimate = Estimate { exposure: start.exposure, ..Estimate::default() };
        let pictures = (&references[..], &self.live);
        candidate(&mut self.aligner, pictures, &world_from_base, &estimate, &schedule)
    }

    fn render(
        &mut self,
        scene: &mut Scene<'_>,
        world_from_base: &Isometry3<f64>,
    ) -> Result<(), GpuError> {
        let camera_from_world = world_from_base.inverse().cast();
        let camera = Camera { camera_from_world, ..self.camera.clone() };
        let drawn = scene.trainer.renderer().draw_color(scene.gaussians, &camera)?;
        let drawn = drawn.expect("the tracker does not ask an empty map");
        let mut recorder = Recorder::new(&self.gpu)?;
        let image = (drawn.image, drawn.pixels);
        self.pyramids.fill_rendered(&mut recorder, &self.rendered, image)?;
        recorder.submit();
        Ok(())
    }

    /// Aligns the frame with the one before, if there is one.
    ///
    /// # Errors
    /// Those of the device.
    pub fn align_with_last(&mut self, start: &Start) -> Result<Option<Candidate>, GpuError> {
        let Some(last) = self.last_found else { return Ok(None) };
        let reference = Reference {
            pyramid: &self.last,
            world_from_reference: last.world_from_camera,
            exposure: last.exposure,
            weight: 1.0,
        };
        let schedule = self.schedule(false, None);
        let estimate = Estimate { exposure: last.exposure, ..Estimate::default() };
        let pictures = (&[reference][..], &self.live);
        candidate(&mut self.aligner, pictures, &start.pose, &estimate, &schedule).map(Some)
    }

    /// One of so many pixels of the finest level is compared.
    fn stride(&self) -> u32 {
        let stride = self.camera.pixels() / self.config.pixels.max(1);
        stride.clamp(1, MOST_STRIDE) as u32
    }

    fn schedule(&self, wide: bool, prior: Option<Prior>) -> Schedule {
        let config = &self.config;
        let mut steps = if wide { config.wide_steps.clone() } else { config.steps.clone() };
        steps.truncate(self.levels);
        let narrow = AlignSettings {
            photometric_weight: config.photometric_weight,
            geometric_weight: config.geometric_weight,
            depth_noise: config.depth_noise,
            stride: self.stride(),
            ..AlignSettings::default()
        };
        let settings = if wide { widened(&narrow) } else { narrow };
        Schedule { steps, settings, with_exposure: config.exposure, prior, ..Schedule::default() }
    }
}

/// For a start that may be far off.
fn widened(narrow: &AlignSettings) -> AlignSettings {
    AlignSettings {
        photometric_threshold: WIDE * narrow.photometric_threshold,
        geometric_threshold: WIDE * narrow.geometric_threshold,
        depth_gate: WIDE * narrow.depth_gate,
        normal_gate: -1.0,
        ..*narrow
    }
}

/// Where the alignment ends.
fn candidate(
    aligner: &mut Aligner,
    pictures: (&[Reference<'_>], &Pyramid),
    world_from_base: &Isometry3<f64>,
    start: &Estimate,
    schedule: &Schedule,
) -> Result<Candidate, GpuError> {
    let (aligned, systems) = joint::align(aligner, pictures, world_from_base, start, schedule)?;
    let mut world_from_camera = world_from_base * aligned.estimate.reference_from_live;
    world_from_camera.rotation.renormalize();
    // What the robot thinks may tell the motions that cannot be seen.
    let conditioning = aligned.system.conditioning(schedule.with_exposure, schedule.prior.as_ref());
    Ok(Candidate {
        world_from_camera,
        exposure: aligned.estimate.exposure,
        evidence: Evidence::of(&systems, conditioning),
        jumped: false,
    })
}

/// What is known of `world_from_camera`, seen from the base: a left perturbation tau of it is Ad tau
/// there, Ad being `base_from_world`'s adjoint.
fn prior(
    base_from_world: &Isometry3<f64>,
    world_from_camera: &Isometry3<f64>,
    information: &Matrix6<f64>,
    pixels: f64,
) -> Prior {
    let inverse = adjoint(&base_from_world.inverse());
    Prior {
        information: inverse.transpose() * information * inverse * pixels,
        reference_from_live: base_from_world * world_from_camera,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::align::se3;
    use nalgebra::Vector6;

    #[test]
    fn a_prior_costs_the_same_seen_from_anywhere() {
        let information = Matrix6::from_diagonal(&Vector6::new(1.0, 4.0, 9.0, 100.0, 400.0, 900.0));
        let expected = se3::exp(&Vector6::new(0.4, -0.2, 0.3, 0.5, -0.8, 0.2));
        let tau = Vector6::new(0.01, 0.02, -0.01, 0.005, -0.01, 0.02);
        let there = se3::exp(&tau) * expected;
        let cost = 0.5 * tau.dot(&(information * tau));
        let base = se3::exp(&Vector6::new(-0.3, 0.1, 0.9, 0.1, 0.7, -0.2));
        let seen = prior(&base, &expected, &information, 1.0);
        let found = seen.cost(&(base * there));
        assert!((found - cost).abs() < 1e-6 * cost, "{found} {cost}");
        assert!(seen.cost(&(base * expected)).abs() < 1e-12);
        assert!((seen.cost(&there) - cost).abs() > 0.1 * cost, "the base matters");
    }
}
