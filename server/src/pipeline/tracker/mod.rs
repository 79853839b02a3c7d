//! Where is the camera? In: a frame and the map. Out: its pose and exposure, or that it is lost.
//!
//! A given pose is believed. Otherwise the frame is aligned, from where the camera should be
//! (constant velocity, or what the robot thinks), coarse to fine, photometric and point to plane, with
//! the pictures of the newest keyframe and of the oldest in sight. Where they show too little, the
//! map is rendered from there, and rendered again if the pose moved far; then the frame before is the
//! reference. The map's picture can join the keyframes' (`map_weight`), but while the map is young it
//! is blurred, and its depth is a few centimetres off: measured, it makes poses worse.
//!
//! Lost is a state: such a frame is not mapped and does not move the velocity; the keyframes that
//! look most like it are tried. The tracker never changes the map.

mod adam;
mod align;
mod config;
mod joint;
mod judge;
mod motion;
mod photometric;
mod places;

pub(super) use adam::Moments;
pub use config::{PhotometricConfig, TrackerConfig, TrackerMethod};
pub(super) use judge::is_blank;

use super::frame::{Frame, TrackingState};
use super::working::Working;
use align::{Candidate, Front, Start};
use judge::Evidence;
use lexsplat_gpu::{Gaussians, Gpu, GpuError, Trainer};
use motion::{LONG_PAUSE, Motion, SHORT_PAUSE};
use nalgebra::Isometry3;
use places::{Places, Thumbnail};

/// The map as the tracker sees it.
pub(super) struct Scene<'a> {
    /// Draws it.
    pub trainer: &'a mut Trainer,
    /// What is drawn.
    pub gaussians: &'a Gaussians,
}

/// What is known of a tracked frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tracked {
    /// The pose.
    pub world_from_camera: Isometry3<f64>,
    /// (a, b): the map's intensity = exp(a) of the frame's + b.
    pub exposure: [f64; 2],
    /// Whether the pose is the tracker's own.
    pub is_estimated: bool,
    /// Whether the pose was found anew: the frame before was lost, or the camera jumped.
    pub relocalised: bool,
}

impl Tracked {
    /// The other way round: (a, b) so that the frame shows exp(a) of the map's color + b.
    pub fn seen_exposure(&self) -> [f32; 2] {
        inverse_exposure(self.exposure).map(|value| value as f32)
    }
}

/// If x = exp(a) y + b, then y = exp(a') x + b'.
pub(super) fn inverse_exposure([a, b]: [f64; 2]) -> [f64; 2] {
    [-a, -b * (-a).exp()]
}

/// Says where each frame was taken.
pub(super) struct Tracker {
    config: TrackerConfig,
    gpu: Gpu,
    /// Kernels and images, from the first frame without a pose on.
    front: Option<Front>,
    motion: Motion,
    exposure: [f64; 2],
    places: Places,
    state: TrackingState,
}

impl Tracker {
    /// Before the first frame.
    pub fn new(gpu: &Gpu, config: &TrackerConfig) -> Self {
        Self {
            config: config.clone(),
            gpu: gpu.clone(),
            front: None,
            motion: Motion::default(),
            exposure: [0.0; 2],
            places: Places::default(),
            state: TrackingState::Empty,
        }
    }

    /// The next frame is another sender's: where its camera is, is not known. It is looked for as one that
    /// was lost, near the newest pose and then in the whole map.
    pub fn resume(&mut self) {
        if self.state == TrackingState::Tracking {
            self.state = TrackingState::Lost;
        }
    }

    /// After the newest frame.
    pub fn state(&self) -> TrackingState {
        self.state
    }

    /// A keyframe was made; returns the memory that its picture takes here beside `working`, bytes.
    pub fn add_keyframe(&mut self, frame: &Frame, working: &Working, tracked: &Tracked) -> u64 {
        let is_shared = Working::columns(frame, self.config.width) == working.camera.width;
        let picture = if is_shared {
            working.clone()
        } else {
            Working::of(frame, &tracked.world_from_camera, self.config.width)
        };
        let bytes = if is_shared { 0 } else { picture.bytes() };
        self.places.add(frame.sequence, picture, tracked);
        bytes
    }

    /// A keyframe was let go.
    pub fn forget_keyframe(&mut self, sequence: u64) {
        self.places.forget(sequence);
    }

    /// A keyframe's pose or exposure was refined.
    pub fn correct_keyframe(&mut self, sequence: u64, pose: Isometry3<f64>, exposure: [f64; 2]) {
        self.places.correct(sequence, pose, exposure);
    }

    /// Where the frame was taken; `None` if that is not known.
    ///
    /// # Errors
    /// Those of the device.
    pub fn track(
        &mut self,
        frame: &Frame,
        scene: &mut Scene<'_>,
    ) -> Result<Option<Tracked>, GpuError> {
        let was_lost = self.state == TrackingState::Lost && self.motion.last().is_some();
        let found = match frame.world_from_camera {
            Some(pose) => Some(Candidate::given(pose)),
            None => self.estimate(frame, scene)?,
        };
        let Some(Candidate { world_from_camera, exposure, jumped, .. }) = found else {
            self.state = TrackingState::Lost;
            return Ok(None);
        };
        if was_lost || jumped {
            self.motion.restart(world_from_camera, frame.timestamp_nanos);
        } else {
            self.motion.follow(world_from_camera, frame.timestamp_nanos);
        }
        self.state = TrackingState::Tracking;
        self.exposure = exposure;
        let is_estimated = frame.world_from_camera.is_none();
        let relocalised = (was_lost || jumped) && is_estimated;
        Ok(Some(Tracked { world_from_camera, exposure, is_estimated, relocalised }))
    }

    fn estimate(
        &mut self,
        frame: &Frame,
        scene: &mut Scene<'_>,
    ) -> Result<Option<Candidate>, GpuError> {
        let working = Working::of(frame, &Isometry3::identity(), self.config.width);
        if is_blank(&working) {
            return Ok(None);
        }
        if self.front.is_none() {
            self.front = Front::new(&self.gpu, &working.camera, &self.config)?;
        }
        let Some(front) = &mut self.front else { return Ok(None) };
        front.see(&working)?;
        let found = if scene.gaussians.is_empty() {
            let hint = frame.hint.as_ref().map(|hint| hint.world_from_camera);
            Some(Candidate::given(hint.unwrap_or_default()))
        } else if self.config.method == TrackerMethod::Photometric {
            let start = (self.motion.last().unwrap_or_default(), self.exposure);
            let config = &self.config.photometric;
            Some(photometric::track(&self.gpu, scene, &working, start, config)?)
        } else {
            self.search(frame, &working, scene)?
        };
        if let (Some(front), Some(found)) = (&mut self.front, &found) {
            front.keep(found);
        }
        Ok(found)
    }

    /// Tries one start after the other until a pose is believed.
    fn search(
        &mut self,
        frame: &Frame,
        working: &Working,
        scene: &mut Scene<'_>,
    ) -> Result<Option<Candidate>, GpuError> {
        let (config, exposure) = (&self.config, self.exposure);
        let front = self.front.as_mut().expect("estimate makes it first");
        let (sequence, nanos) = (frame.sequence, frame.timestamp_nanos);
        let is_lost = self.state == TrackingState::Lost;
        // After a guess, only what agrees as well as a place found again.
        let is_believed = |evidence: &Evidence| {
            if is_lost { evidence.is_found_again(config) } else { evidence.is_tracked(config) }
        };
        let start = |pose, wide| Start { pose, exposure, wide, prior: None };
        let hint = frame.hint.as_ref().and_then(|hint| Start::of_hint(hint, exposure));
        let ahead = self.motion.predict(nanos, SHORT_PAUSE).filter(|_| !is_lost);
        let ahead = ahead.map(|pose| start(pose, false));
        let wanted = (config.keyframes, config.keyframe_overlap);
        for start in hint.iter().chain(&ahead) {
            let keyframes = self.places.around((&working.camera, &start.pose), wanted);
            for references in [&keyframes[..], &[]] {
                let found = front.align_with_map(scene, start, references)?;
                let against = references.len();
                tracing::debug!(sequence, against, ?found.evidence, exposure = ?found.exposure);
                if is_believed(&found.evidence) {
                    return Ok(Some(found));
                }
            }
        }
        if let Some(start) = &ahead
            && let Some(found) = front.align_with_last(start)?
        {
            tracing::debug!(sequence, ?found.evidence, "against the frame before");
            if found.evidence.is_tracked(config) {
                return Ok(Some(found));
            }
        }
        // Farther and farther away.
        let still = self.motion.last().map(|pose| start(pose, true));
        let far = self.motion.predict(nanos, LONG_PAUSE).map(|pose| start(pose, true));
        let newest = |start: Start| {
            let places = self.places.around((&working.camera, &start.pose), wanted);
            (start, places)
        };
        let thumbnail = Thumbnail::of(working);
        let like = self.places.like(&thumbnail, config.relocalise_keyframes);
        let like = like.into_iter().map(|place| (Start::anywhere(place), vec![place]));
        for (start, places) in still.into_iter().chain(far).map(newest).chain(like) {
            let found = front.align_with_map(scene, &start, &places)?;
            tracing::debug!(sequence, ?found.evidence, "against a place seen before");
            if found.evidence.is_found_again(config) {
                return Ok(Some(Candidate { jumped: true, ..found }));
            }
        }
        tracing::info!(sequence, "the camera is lost");
        Ok(None)
    }
}

#[cfg(test)]
mod tests;
