//! The device's part of tracking: uploads the frame and its references, and aligns them.
//!
//! In: downsampled frames, initial poses ([`InitialPose`]) and keyframes. Out: [`PoseCandidate`]s, which the
//! tracker accepts or not.

mod images;
mod last;
mod prior;

use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::Frame;
use super::super::keyframes::Keyframe;
use super::super::pose_covariance::carried;
use super::candidate::{InitialPose, PoseCandidate};
use super::config::TrackerConfig;
use super::multi_reference::{self, Reference};
use super::quality::{self, AlignmentQuality};
use super::scene::Scene;
use super::uncertainty;
use images::{Images, is_for, within_levels};
use lexsplat_gpu::Recorder;
use lexsplat_gpu::align::Prior;
use lexsplat_gpu::{
    AlignSettings, Aligner, Camera, Estimate, Gpu, GpuError, NormalSystem, Pyramid, Schedule,
};
use nalgebra::Isometry3;
use prior::prior;
use std::sync::Arc;

/// Factor of thresholds and gates for a wide initial pose.
const WIDE_FACTOR: f64 = 5.0;
/// Most narrow alignments after a wide one.
const MAX_NARROW_ALIGNMENTS: usize = 4;
/// The narrow alignments end when the pose moves less than this, metres and radians.
const SETTLED: f64 = 1e-3;
/// A step from a narrow start that moves less is taken unseen at the finest level, metres and radians. From
/// a wide start each step is looked at: without that, single pictures far apart are found less often.
const SMALLEST_STEP: f64 = 2e-4;
/// The check with exchanged roles looks at one in this many of the pixels that are aligned.
const CHECKED_STRIDE: u32 = 4;
/// Largest stride between compared pixels that [`AlignSettings`] takes.
const MAX_STRIDE: usize = 64;

/// Kernels and images of the alignment. Each image has the camera that took it.
pub(super) struct FrameAligner {
    gpu: Gpu,
    config: TrackerConfig,
    images: Images,
    aligner: Aligner,
    /// The map rendered from the initial pose.
    rendered: Option<Arc<Pyramid>>,
    /// The frame to be aligned, if it is not kept as another one.
    live: Option<Uploaded>,
    /// The last tracked frame, and where it was found.
    last: Option<(Uploaded, PoseCandidate)>,
    /// The last lost frame, if it was kept.
    stray: Option<Arc<Pyramid>>,
    /// Images of the keyframes used last, by sequence number.
    keyframes: Vec<(u64, Arc<Pyramid>)>,
}

/// A frame on the device.
struct Uploaded {
    /// Its number; `None` if it was put back from a checkpoint.
    sequence: Option<u64>,
    image: DownsampledFrame,
    pyramid: Arc<Pyramid>,
}

impl FrameAligner {
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn new(gpu: &Gpu, config: &TrackerConfig) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: gpu.clone(),
            config: config.clone(),
            images: Images::new(gpu, config)?,
            aligner: Aligner::new(gpu)?,
            rendered: None,
            live: None,
            last: None,
            stray: None,
            keyframes: Vec::new(),
        })
    }

    /// Uploads a new frame, which may have another camera than the one before. Returns false if it is too
    /// small to be aligned.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn upload(&mut self, frame: &DownsampledFrame, sequence: u64) -> Result<bool, GpuError> {
        if let Some(before) = self.live.take() {
            self.images.give_back(before.pyramid);
        }
        let Some(pyramid) = self.images.make(frame)? else { return Ok(false) };
        let sequence = Some(sequence);
        self.live = Some(Uploaded { sequence, image: frame.clone(), pyramid });
        Ok(true)
    }

    /// Whether this frame was uploaded last, and not tracked.
    pub fn is_uploaded(&self, frame: &Frame) -> bool {
        self.live.as_ref().is_some_and(|live| live.sequence == Some(frame.sequence))
    }

    /// Keeps the uploaded frame, which was tracked, as the last frame.
    pub fn keep_as_last(&mut self, found: &PoseCandidate) {
        let Some(live) = self.live.take() else { return };
        if let Some((before, _)) = self.last.replace((live, *found)) {
            self.images.give_back(before.pyramid);
        }
    }

    /// Keeps the uploaded frame, which was lost.
    pub fn keep_as_stray(&mut self) {
        let Some(live) = self.live.take() else { return };
        if let Some(before) = self.stray.replace(live.pyramid) {
            self.images.give_back(before);
        }
    }

    /// Aligns the frame with keyframes, and with the map rendered at the initial pose if `map_weight` is set
    /// or there are no keyframes. Aligns again from the result if that is far from the initial pose.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn align_with_map(
        &mut self,
        scene: &mut Scene<'_>,
        start: &InitialPose,
        keyframes: &[&Keyframe],
    ) -> Result<PoseCandidate, GpuError> {
        self.upload_keyframes(keyframes)?;
        let base = &start.world_from_camera;
        let mut found = self.align_from(scene, base, start, start.is_wide, keyframes)?;
        let (metres, radians) = distance(base, &found.world_from_camera);
        let is_far = metres > self.config.rerender_metres || radians > self.config.rerender_radians;
        // Quality is judged with narrow thresholds, so a wide start is aligned until it has settled.
        let most = if start.is_wide { MAX_NARROW_ALIGNMENTS } else { usize::from(is_far) };
        for _ in 0..most {
            if found.quality.overlap < self.config.min_overlap {
                break;
            }
            let nearer = InitialPose { exposure: found.exposure, ..start.clone() };
            let base = found.world_from_camera;
            found = self.align_from(scene, &base, &nearer, false, keyframes)?;
            let (metres, radians) = distance(&base, &found.world_from_camera);
            if metres < SETTLED && radians < SETTLED {
                break;
            }
        }
        Ok(found)
    }

    /// Puts the images of these keyframes on the device, in place of those that are no longer used. One
    /// that is too small, whose pose was given, is left out.
    fn upload_keyframes(&mut self, keyframes: &[&Keyframe]) -> Result<(), GpuError> {
        let is_wanted = |sequence: u64| keyframes.iter().any(|kf| kf.frame.sequence == sequence);
        let (kept, unused): (Vec<_>, Vec<_>) =
            self.keyframes.drain(..).partition(|(sequence, _)| is_wanted(*sequence));
        self.keyframes = kept;
        unused.into_iter().for_each(|(_, pyramid)| self.images.give_back(pyramid));
        for keyframe in keyframes {
            let sequence = keyframe.frame.sequence;
            if self.keyframes.iter().any(|(uploaded, _)| *uploaded == sequence) {
                continue;
            }
            // A new keyframe is the last frame.
            let last = self.last.as_ref().map(|(last, _)| last);
            let same = last.filter(|last| {
                last.sequence == Some(sequence) && is_for(&last.pyramid, &keyframe.tracking.camera)
            });
            let pyramid = match same {
                Some(last) => Some(last.pyramid.clone()),
                None => self.images.make(&keyframe.tracking)?,
            };
            self.keyframes.extend(pyramid.map(|pyramid| (sequence, pyramid)));
        }
        Ok(())
    }

    /// Renders the map at `world_from_base` if needed and aligns the frame with it and the keyframes.
    fn align_from(
        &mut self,
        scene: &mut Scene<'_>,
        world_from_base: &Isometry3<f64>,
        start: &InitialPose,
        is_wide: bool,
        keyframes: &[&Keyframe],
    ) -> Result<PoseCandidate, GpuError> {
        let map_weight = if keyframes.is_empty() { 1.0 } else { self.config.map_weight };
        if map_weight > 0.0 {
            self.render(scene, world_from_base)?;
        }
        let rendered = self.rendered.clone().filter(|_| map_weight > 0.0);
        let rendered = rendered.map(|pyramid| Reference {
            pyramid,
            world_from_reference: *world_from_base,
            exposure: [0.0; 2],
            weight: map_weight,
        });
        let uploaded = keyframes.iter().filter_map(|keyframe| self.reference(keyframe));
        let references: Vec<Reference> = rendered.into_iter().chain(uploaded).collect();
        let prior = start.information.as_ref().map(|information| {
            // Neighbouring pixels are correlated, and only some of them are compared.
            let stride = self.stride(references.len());
            let pixels = self.config.correlated_pixels / f64::from(stride);
            let base_from_world = world_from_base.inverse();
            let mut prior = prior(&base_from_world, &start.world_from_camera, information);
            prior.information *= pixels;
            prior
        });
        let schedule = self.schedule(is_wide, prior, references.len());
        let estimate = Estimate { exposure: start.exposure, ..Estimate::default() };
        let live = self.live_pyramid();
        align(&mut self.aligner, &references, &live, world_from_base, &estimate, &schedule)
    }

    /// A keyframe as a reference, if it is on the device.
    fn reference(&self, keyframe: &Keyframe) -> Option<Reference> {
        let sequence = keyframe.frame.sequence;
        let (_, pyramid) = self.keyframes.iter().find(|(uploaded, _)| *uploaded == sequence)?;
        Some(Reference {
            pyramid: pyramid.clone(),
            world_from_reference: keyframe.frame.world_from_camera,
            exposure: keyframe.map_exposure,
            weight: 1.0,
        })
    }

    fn live_pyramid(&self) -> Arc<Pyramid> {
        self.live.as_ref().expect("the frame was uploaded").pyramid.clone()
    }

    fn render(
        &mut self,
        scene: &mut Scene<'_>,
        world_from_base: &Isometry3<f64>,
    ) -> Result<(), GpuError> {
        let live = self.live_pyramid();
        let own = &live.levels()[0].camera;
        let rendered = self.rendered.take().filter(|rendered| is_for(rendered, own));
        let rendered = match rendered {
            Some(rendered) => Some(rendered),
            None => self.images.empty(own)?.map(Arc::new),
        };
        let rendered = rendered.expect("the frame is large enough");
        let camera_from_world = world_from_base.inverse().cast();
        let camera = Camera { camera_from_world, ..own.clone() };
        let drawn = scene.trainer.renderer().draw_color(scene.gaussians, &camera)?;
        let drawn = drawn.expect("the tracker does not ask an empty map");
        let mut recorder = Recorder::new(&self.gpu)?;
        let pyramids = &self.images.pyramids;
        pyramids.fill_rendered(&mut recorder, &rendered, drawn.image, drawn.pixels)?;
        recorder.submit();
        self.rendered = Some(rendered);
        Ok(())
    }

    /// Aligns the frame with the last tracked one; `None` if there is none.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn align_with_last(
        &mut self,
        start: &InitialPose,
    ) -> Result<Option<PoseCandidate>, GpuError> {
        let Some((last, found)) = &self.last else { return Ok(None) };
        let reference = Reference {
            pyramid: last.pyramid.clone(),
            world_from_reference: found.world_from_camera,
            exposure: found.exposure,
            weight: 1.0,
        };
        let estimate = Estimate { exposure: found.exposure, ..Estimate::default() };
        self.align_narrowly(reference, &start.world_from_camera, &estimate).map(Some)
    }

    /// Aligns the frame with the lost one that was kept, in that frame's coordinates; `None` if there is
    /// none.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn align_with_stray(&mut self) -> Result<Option<PoseCandidate>, GpuError> {
        let base = Isometry3::identity();
        let Some(pyramid) = self.stray.clone() else { return Ok(None) };
        let reference =
            Reference { pyramid, world_from_reference: base, exposure: [0.0; 2], weight: 1.0 };
        self.align_narrowly(reference, &base, &Estimate::default()).map(Some)
    }

    /// Aligns the frame with one reference.
    fn align_narrowly(
        &mut self,
        reference: Reference,
        world_from_base: &Isometry3<f64>,
        start: &Estimate,
    ) -> Result<PoseCandidate, GpuError> {
        let schedule = self.schedule(false, None, 1);
        let live = self.live_pyramid();
        align(&mut self.aligner, &[reference], &live, world_from_base, start, &schedule)
    }

    /// Every how many pixels of the finest level one is compared with a reference. Several references
    /// share the pixels that are compared.
    fn stride(&self, references: usize) -> u32 {
        let live = self.live.as_ref().or(self.last.as_ref().map(|(last, _)| last));
        let pixels = live.map_or(1, |live| references * live.pyramid.levels()[0].camera.pixels());
        let stride = pixels / self.config.pixels.max(1);
        stride.clamp(1, MAX_STRIDE) as u32
    }

    fn schedule(&self, is_wide: bool, prior: Option<Prior>, references: usize) -> Schedule {
        let config = &self.config;
        let steps = if is_wide { config.wide_steps.clone() } else { config.steps.clone() };
        let narrow = AlignSettings {
            photometric_weight: config.photometric_weight,
            geometric_weight: config.geometric_weight,
            depth_noise: config.depth_noise,
            stride: self.stride(references),
            ..AlignSettings::default()
        };
        let settings = if is_wide { widened(&narrow) } else { narrow };
        Schedule {
            steps,
            settings,
            with_exposure: config.exposure,
            prior,
            smallest_step: if is_wide { 0.0 } else { SMALLEST_STEP },
        }
    }
}

/// Settings for an initial pose that may be far off.
fn widened(narrow: &AlignSettings) -> AlignSettings {
    AlignSettings {
        photometric_threshold: WIDE_FACTOR * narrow.photometric_threshold,
        geometric_threshold: WIDE_FACTOR * narrow.geometric_threshold,
        depth_gate: WIDE_FACTOR * narrow.depth_gate,
        normal_gate: -1.0,
        ..*narrow
    }
}

/// Translation in metres and rotation in radians between two poses.
pub(super) fn distance(from: &Isometry3<f64>, to: &Isometry3<f64>) -> (f64, f64) {
    let motion = from.inverse() * to;
    (motion.translation.vector.norm(), motion.rotation.angle())
}

/// Runs the alignment and measures the quality of its result.
fn align(
    aligner: &mut Aligner,
    references: &[Reference],
    live: &Pyramid,
    world_from_base: &Isometry3<f64>,
    start: &Estimate,
    schedule: &Schedule,
) -> Result<PoseCandidate, GpuError> {
    let schedule = &within_levels(schedule, references, live);
    let (aligned, systems) =
        multi_reference::align(aligner, references, live, world_from_base, start, schedule)?;
    let base_from_camera = aligned.estimate.reference_from_live;
    let mut world_from_camera = world_from_base * base_from_camera;
    world_from_camera.rotation.renormalize();
    // A prior constrains motions that the images do not show.
    let conditioning = aligned.system.conditioning(schedule.with_exposure, schedule.prior.as_ref());
    let exposure = aligned.estimate.exposure;
    let best = quality::best(&systems);
    let seen_from_reference = match best {
        Some(at) => {
            let estimate = multi_reference::reversed(&references[at], &world_from_camera, exposure);
            let levels = (&live.levels()[0], &references[at].pyramid.levels()[0]);
            let stride = (schedule.settings.stride * CHECKED_STRIDE).min(MAX_STRIDE as u32);
            let settings = AlignSettings { stride, ..schedule.settings };
            aligner.system(levels.0, levels.1, &estimate, &settings)?
        }
        None => NormalSystem::default(),
    };
    let system = best.map(|at| &systems[at]);
    let (with_exposure, stride) = (schedule.with_exposure, schedule.settings.stride);
    let covariance = uncertainty::covariance(&aligned.system, with_exposure, stride);
    Ok(PoseCandidate {
        world_from_camera,
        exposure,
        covariance: Some(carried(&base_from_camera.inverse(), &covariance)),
        quality: AlignmentQuality::of(system, &seen_from_reference, conditioning),
        beside: None,
        jumped: false,
    })
}
