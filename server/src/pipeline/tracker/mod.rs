//! Estimates the pose of each frame.
//!
//! In: a frame and the map. Out: its pose and exposure, or that it is lost.
//!
//! A given pose is taken as it is. Otherwise the frame is aligned coarse to fine, photometrically and point
//! to plane, with the newest keyframe and the oldest ones in view, and with the map if `map_weight` is set.
//! It starts from the pose that constant velocity predicts, or from the robot's own estimate.
//!
//! A judge (`judge.rs`) decides from the pixels that contradict a pose whether it is convincing. If not,
//! other starts are tried (`search.rs`). The best believable pose is taken.
//!
//! A frame without such a pose is lost. It is not mapped and does not change the velocity. The tracker never
//! changes the map. If the map is young and nothing can be tracked in it, it asks for a new beginning.

mod candidate;
mod comparison;
mod config;
mod frame_aligner;
mod judge;
mod motion;
mod multi_reference;
mod photometric;
mod quality;
mod saving;
mod scene;
mod search;
mod state;
mod uncertainty;
mod young_map;

pub(super) use comparison::Comparison;
pub use config::{PhotometricConfig, TrackerConfig, TrackerMethod};
pub(super) use scene::Scene;
pub(super) use state::TrackerState;

use super::downsampled_frame::DownsampledFrame;
use super::frame::{Frame, TrackedPose, TrackingState};
use super::keyframes::{Keyframe, KeyframeStore, Thumbnail};
use candidate::{InitialPose, PoseCandidate};
use frame_aligner::FrameAligner;
use judge::Judge;
use lexsplat_gpu::{Camera, Gpu, GpuError};
use lexsplat_pictures::{FeaturePose, Features};
use motion::{Expected, LONG_PAUSE, Motion, SHORT_PAUSE};
use nalgebra::Isometry3;
use quality::{AlignmentQuality, usable_share};
use search::{Origin, Search, is_searched_far};
use std::cmp::Reverse;
use young_map::YoungMap;

/// Estimates poses, one frame after the other.
pub(super) struct Tracker {
    config: TrackerConfig,
    gpu: Gpu,
    /// Made with the first frame that has no pose.
    aligner: Option<FrameAligner>,
    motion: Motion,
    /// Exposure of the last tracked frame.
    exposure: [f64; 2],
    state: TrackingState,
    judge: Judge,
    young: YoungMap,
    /// Share of the newest frame's pixels that are usable; 0 if the map is not young.
    usable: f64,
}

/// What became of a frame.
pub(super) enum Tracking {
    Found(Box<TrackedPose>),
    Lost,
    /// The frame is not in the map, but it agrees with this earlier one, which was lost too. The map has only
    /// a few frames: it is to be emptied and begun with the earlier frame.
    BeginAnew(Box<Frame>),
}

impl Tracker {
    pub fn new(gpu: &Gpu, config: &TrackerConfig) -> Self {
        Self {
            config: config.clone(),
            gpu: gpu.clone(),
            aligner: None,
            motion: Motion::default(),
            exposure: [0.0; 2],
            state: TrackingState::Empty,
            judge: Judge::default(),
            young: YoungMap::default(),
            usable: 0.0,
        }
    }

    /// Treats the next frame as lost because it comes from another stream, whose camera may be anywhere.
    pub fn resume(&mut self) {
        self.young.resume();
        if self.state == TrackingState::Tracking {
            self.state = TrackingState::Lost;
        }
    }

    /// State after the newest frame.
    pub fn state(&self) -> TrackingState {
        self.state
    }

    /// [`Motion::during`].
    pub fn motion_during(&self, frame: &Frame, lag_nanos: i64) -> Option<Isometry3<f64>> {
        self.motion.during(frame, lag_nanos)
    }

    /// Estimates the pose of a frame.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn track(&mut self, frame: &Frame, scene: &mut Scene<'_>) -> Result<Tracking, GpuError> {
        let was_lost = self.state == TrackingState::Lost && self.motion.last().is_some();
        let found = match frame.world_from_camera {
            Some(pose) => Some(PoseCandidate::given(pose)),
            None => self.estimate(frame, scene)?,
        };
        let Some(candidate) = found else {
            self.state = TrackingState::Lost;
            return self.lost(frame);
        };
        let PoseCandidate { world_from_camera, exposure, jumped, quality, .. } = candidate;
        if was_lost || jumped {
            self.motion.restart(world_from_camera, frame.timestamp_nanos);
        } else {
            self.motion.follow(world_from_camera, frame.timestamp_nanos);
        }
        self.state = TrackingState::Tracking;
        self.exposure = exposure;
        let is_estimated = frame.world_from_camera.is_none();
        if is_estimated && !scene.gaussians.is_empty() {
            self.judge.learn(&quality);
        }
        self.young.tracked(is_estimated, self.usable);
        let relocalised = (was_lost || jumped) && is_estimated;
        Ok(Tracking::Found(Box::new(candidate.tracked(is_estimated, relocalised))))
    }

    /// A frame is lost. If the map is young, it is kept, or the map begins anew.
    fn lost(&mut self, frame: &Frame) -> Result<Tracking, GpuError> {
        // A blank frame was not uploaded.
        let Some(aligner) = self.aligner.as_mut().filter(|aligner| aligner.is_uploaded(frame))
        else {
            return Ok(Tracking::Lost);
        };
        if self.young.may_begin_anew() {
            let quality = aligner.align_with_stray()?.map(|found| found.quality);
            tracing::debug!(sequence = frame.sequence, ?quality, "aligned with a lost frame");
            let is_good = |quality: &AlignmentQuality| {
                quality.is_tracked(&self.config)
                    && Judge::default().is_believable(quality, &self.config)
            };
            if quality.as_ref().is_some_and(is_good)
                && let Some(stray) = self.young.take_stray()
            {
                return Ok(Tracking::BeginAnew(Box::new(stray)));
            }
        }
        if self.young.lost(frame, self.usable) {
            aligner.keep_as_stray();
        }
        Ok(Tracking::Lost)
    }

    fn estimate(
        &mut self,
        frame: &Frame,
        scene: &mut Scene<'_>,
    ) -> Result<Option<PoseCandidate>, GpuError> {
        let sent = DownsampledFrame::new(frame, &Isometry3::identity(), self.config.width);
        let image = sent.without_gaps();
        self.usable = if self.young.is_kept() { 0.0 } else { usable_share(&image) };
        if self.young.passes_over(&image, scene.gaussians.is_empty()) {
            return Ok(None);
        }
        // Taken out, so that it can be borrowed beside the tracker's other fields.
        let mut aligner = match self.aligner.take() {
            Some(aligner) => aligner,
            None => FrameAligner::new(&self.gpu, &self.config)?,
        };
        let found = if !aligner.upload(&image, frame.sequence)? {
            None
        } else if scene.gaussians.is_empty() {
            // A frame that is held out adds nothing to a map, so none can begin with it.
            let hint = frame.hint.as_ref().map(|hint| hint.world_from_camera);
            (!frame.held_out).then(|| PoseCandidate::given(hint.unwrap_or_default()))
        } else if self.config.method == TrackerMethod::Photometric {
            let (gpu, config) = (&self.gpu, &self.config.photometric);
            let start = self.motion.last().unwrap_or_default();
            Some(photometric::track(gpu, scene, &image, &start, self.exposure, config)?)
        } else {
            self.search(&mut aligner, frame, &image, scene)?
        };
        tracing::debug!(sequence = frame.sequence, quality = ?found.map(|found| found.quality), "accepted");
        if let Some(found) = &found {
            aligner.keep_as_last(found);
        }
        self.aligner = Some(aligner);
        Ok(found)
    }

    /// Tries initial poses, the most likely first, until a result is convincing. Returns the best of them
    /// if it is believable.
    fn search(
        &self,
        aligner: &mut FrameAligner,
        frame: &Frame,
        image: &DownsampledFrame,
        scene: &mut Scene<'_>,
    ) -> Result<Option<PoseCandidate>, GpuError> {
        let expected = self.expected(frame);
        let mut search = Search::new(&self.config, &self.judge, frame.sequence, expected);
        self.search_near(&mut search, aligner, frame, image, scene)?;
        if !search.is_done() {
            self.search_by_features(&mut search, aligner, image, scene)?;
        }
        if !search.has_found() && is_searched_far(self.young.lost_frames()) {
            self.search_far(&mut search, aligner, frame, image, scene)?;
        }
        let found = search.best();
        if found.is_none() {
            tracing::info!(sequence = frame.sequence, "the camera is lost");
        }
        Ok(found)
    }

    /// Starts from the robot's own estimate and from the predicted pose.
    fn search_near(
        &self,
        search: &mut Search<'_>,
        aligner: &mut FrameAligner,
        frame: &Frame,
        image: &DownsampledFrame,
        scene: &mut Scene<'_>,
    ) -> Result<(), GpuError> {
        let is_lost = self.state == TrackingState::Lost;
        // While lost, a hint is a guess.
        let origin = if is_lost { Origin::Guess } else { Origin::Prediction };
        let hint = frame.hint.as_ref().and_then(|hint| InitialPose::from_hint(hint, self.exposure));
        let predicted = self.expected(frame).map(|at| self.start(at.world_from_camera, false));
        for start in hint.iter().chain(&predicted) {
            let keyframes = self.references(scene, image, start);
            search.add(origin, aligner.align_with_map(scene, start, &keyframes)?);
            if search.is_done() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Looks whether features confirm a result, and if not starts from keyframes that share features with
    /// the frame.
    fn search_by_features(
        &self,
        search: &mut Search<'_>,
        aligner: &mut FrameAligner,
        image: &DownsampledFrame,
        scene: &mut Scene<'_>,
    ) -> Result<(), GpuError> {
        let features = Features::detect(&image.picture());
        if let Some(expected) = search.expected() {
            search
                .confirm(&features, &self.references_at(scene.keyframes, &image.camera, expected));
            if search.is_done() {
                return Ok(());
            }
        }
        let count = self.config.relocalise_keyframes;
        let mut matched: Vec<(FeaturePose, &Keyframe)> = scene
            .keyframes
            .most_alike(&features, 2 * count, |_| true)
            .into_iter()
            .filter_map(|kf| Some((FeaturePose::find(&features, &kf.features)?, kf)))
            .collect();
        matched.sort_by_key(|(pose, _)| Reverse(pose.pairs));
        for (pose, keyframe) in matched.into_iter().take(count) {
            if search.has_found() && !keyframe.is_connected {
                continue;
            }
            let start = InitialPose::beside_keyframe(keyframe, &pose.keyframe_from_camera);
            // The others drifted away from one that is not connected.
            let beside_all = keyframe.is_connected.then(|| self.references(scene, image, &start));
            let mut references = beside_all.unwrap_or_default();
            if !references.iter().any(|kf| kf.frame.sequence == keyframe.frame.sequence) {
                references.push(keyframe);
            }
            let found = aligner.align_with_map(scene, &start, &references)?;
            search.add(Origin::Features, found.beside(keyframe));
            if search.is_done() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Starts from the last frame, from the rendered map, from the last pose, from a pose far along the
    /// motion, and from keyframes that look like the frame.
    fn search_far(
        &self,
        search: &mut Search<'_>,
        aligner: &mut FrameAligner,
        frame: &Frame,
        image: &DownsampledFrame,
        scene: &mut Scene<'_>,
    ) -> Result<(), GpuError> {
        if let Some(expected) = self.expected(frame) {
            let start = self.start(expected.world_from_camera, false);
            if let Some(found) = aligner.align_with_last(&start)? {
                search.add(Origin::Prediction, found);
            }
            search.add(Origin::Prediction, aligner.align_with_map(scene, &start, &[])?);
        }
        let still = self.motion.last();
        let far = self
            .motion
            .predict(frame.timestamp_nanos, LONG_PAUSE)
            .filter(|far| Some(*far) != still);
        let near_last = still.into_iter().chain(far).map(|pose| {
            let start = self.start(pose, true);
            let references = self.references(scene, image, &start);
            (start, references)
        });
        let count = self.config.relocalise_keyframes;
        let similar = scene.keyframes.most_similar(&Thumbnail::new(image), count);
        let similar = similar.into_iter().map(|kf| (InitialPose::at_keyframe(kf), vec![kf]));
        let starts: Vec<(InitialPose, Vec<&Keyframe>)> = near_last.chain(similar).collect();
        for (start, references) in starts {
            if search.has_found() {
                return Ok(());
            }
            let found = aligner.align_with_map(scene, &start, &references)?;
            let first = references.first();
            search.add(Origin::Far, first.map_or(found, |keyframe| found.beside(keyframe)));
        }
        Ok(())
    }

    /// Where the camera is expected; `None` while it is lost.
    fn expected(&self, frame: &Frame) -> Option<Expected> {
        let expected = self.motion.expect(frame.timestamp_nanos, SHORT_PAUSE);
        expected.filter(|_| self.state != TrackingState::Lost)
    }

    fn start(&self, world_from_camera: Isometry3<f64>, is_wide: bool) -> InitialPose {
        InitialPose { world_from_camera, exposure: self.exposure, is_wide, information: None }
    }

    /// The keyframes that a frame near this pose is aligned with.
    fn references<'a>(
        &self,
        scene: &Scene<'a>,
        image: &DownsampledFrame,
        start: &InitialPose,
    ) -> Vec<&'a Keyframe> {
        self.references_at(scene.keyframes, &image.camera, &start.world_from_camera)
    }

    /// The keyframes that a frame of a camera at this pose is aligned with.
    pub fn references_at<'a>(
        &self,
        keyframes: &'a KeyframeStore,
        camera: &Camera,
        world_from_camera: &Isometry3<f64>,
    ) -> Vec<&'a Keyframe> {
        let TrackerConfig { keyframes: count, keyframe_overlap, .. } = self.config;
        keyframes.references(camera, world_from_camera, count, keyframe_overlap)
    }

    /// Measures the pose of the newest tracked frame relative to keyframes, where it was tracked.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn compare<'a>(
        &mut self,
        keyframes: &[&'a Keyframe],
    ) -> Result<Vec<(&'a Keyframe, Comparison)>, GpuError> {
        let Self { aligner, config, .. } = self;
        aligner.as_mut().map_or(Ok(Vec::new()), |al| comparison::compare(al, config, keyframes))
    }

    /// Measures the pose of the newest tracked frame relative to a keyframe that may show the same place.
    /// `expected`: `keyframe_from_camera`, if it is known to a few centimetres.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn recognise(
        &mut self,
        features: &Features,
        keyframe: &Keyframe,
        expected: Option<Isometry3<f64>>,
    ) -> Result<Option<Comparison>, GpuError> {
        let Self { aligner, config, judge, .. } = self;
        let Some(aligner) = aligner else { return Ok(None) };
        comparison::recognise(aligner, (config, judge), features, keyframe, expected)
    }
}

#[cfg(test)]
mod tests;
