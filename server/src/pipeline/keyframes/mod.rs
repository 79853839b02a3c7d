//! The store of keyframes: the one owner of all that is known of a keyframe.
//!
//! In: tracked frames that were selected as keyframes, and their language when it is ready. Out: keyframes
//! for the mapper (training images), for the tracker (references near a pose, similar images) and for
//! readers. Forgetting a keyframe is one call. Its last pose is kept, because frames that were tracked
//! relative to it need it.

mod budget;
mod codes;
mod keyframe;
mod language;
mod state;
mod surface_sample;
mod thumbnail;
mod visits;
mod windows;

pub(super) use codes::Codes;
pub(super) use keyframe::{Keyframe, KeyframeWidths};
pub(super) use language::KeyframeLanguage;
pub(super) use state::KeyframeState;
pub(super) use surface_sample::SurfaceSample;
pub(super) use thumbnail::Thumbnail;
pub(super) use visits::{StepKind, Visits};

use super::frame::TrackedFrame;
use lexsplat_gpu::Camera;
use lexsplat_pictures::Features;
use nalgebra::Isometry3;
use std::collections::{BTreeMap, VecDeque};

/// Language targets that stay on the device after their steps.
const LANGUAGE_TARGETS: usize = 8;

/// All keyframes of a map, oldest first.
#[derive(Default)]
pub(super) struct KeyframeStore {
    keyframes: Vec<Keyframe>,
    /// Poses of forgotten keyframes, by sequence number.
    forgotten: BTreeMap<u64, TrackedFrame>,
    /// Keyframes whose language target is on the device, in the order in which it was put there.
    language_targets: VecDeque<u64>,
}

impl KeyframeStore {
    /// A store with these keyframes, and the poses of those that were forgotten.
    pub fn restored(keyframes: Vec<Keyframe>, forgotten: BTreeMap<u64, TrackedFrame>) -> Self {
        Self { keyframes, forgotten, language_targets: VecDeque::new() }
    }

    /// Poses of forgotten keyframes, by sequence number.
    pub fn forgotten(&self) -> &BTreeMap<u64, TrackedFrame> {
        &self.forgotten
    }

    pub fn add(&mut self, keyframe: Keyframe) {
        self.keyframes.push(keyframe);
    }

    pub fn len(&self) -> usize {
        self.keyframes.len()
    }

    /// Oldest first; the newest `n` are `iter().rev().take(n)`.
    pub fn iter(&self) -> std::slice::Iter<'_, Keyframe> {
        self.keyframes.iter()
    }

    pub fn newest(&self) -> Option<&Keyframe> {
        self.keyframes.last()
    }

    /// Position of the keyframe with this sequence number in [`KeyframeStore::iter`].
    pub fn find(&self, sequence: u64) -> Option<usize> {
        self.position(sequence)
    }

    /// The keyframe at a position in [`KeyframeStore::iter`].
    pub fn at(&self, index: usize) -> &Keyframe {
        &self.keyframes[index]
    }

    /// As [`KeyframeStore::at`].
    pub fn at_mut(&mut self, index: usize) -> &mut Keyframe {
        &mut self.keyframes[index]
    }

    /// Index of the keyframe with this sequence number; sequence numbers increase.
    fn position(&self, sequence: u64) -> Option<usize> {
        self.keyframes.binary_search_by_key(&sequence, |kf| kf.frame.sequence).ok()
    }

    pub fn find_mut(&mut self, sequence: u64) -> Option<&mut Keyframe> {
        self.position(sequence).map(|at| &mut self.keyframes[at])
    }

    pub fn contains(&self, sequence: u64) -> bool {
        self.position(sequence).is_some()
    }

    /// Pose and exposure of a keyframe; of a forgotten one as they were last.
    pub fn frame(&self, sequence: u64) -> Option<&TrackedFrame> {
        match self.position(sequence) {
            Some(at) => Some(&self.keyframes[at].frame),
            None => self.forgotten.get(&sequence),
        }
    }

    /// Takes language targets from the device that were put there longest ago; a few stay.
    pub fn release_targets(&mut self) {
        for keyframe in &self.keyframes {
            let sequence = keyframe.frame.sequence;
            let is_there = keyframe.language.as_ref().is_some_and(|one| one.target.is_on_device());
            if is_there && !self.language_targets.contains(&sequence) {
                self.language_targets.push_back(sequence);
            }
        }
        while self.language_targets.len() > LANGUAGE_TARGETS {
            let oldest = self.language_targets.pop_front();
            let oldest = oldest.and_then(|sequence| self.find_mut(sequence));
            if let Some(language) = oldest.and_then(|keyframe| keyframe.language.as_mut()) {
                language.release_target();
            }
        }
    }

    /// Memory of all keyframes, bytes.
    pub fn bytes(&self) -> u64 {
        self.keyframes.iter().map(Keyframe::bytes).sum()
    }

    /// Drops a keyframe and all that belongs to it, except its pose and exposure.
    pub fn forget(&mut self, sequence: u64) {
        if let Some(at) = self.position(sequence) {
            let keyframe = self.keyframes.remove(at);
            self.forgotten.insert(sequence, keyframe.frame);
        }
    }

    /// Forgets redundant keyframes until the others fit into `limit_bytes` or only one is left. Returns
    /// how many were forgotten. The newest `window` keyframes are forgotten last.
    pub fn keep_to_budget(&mut self, limit_bytes: u64, window: usize) -> usize {
        let before = self.len();
        while self.bytes() > limit_bytes {
            let images: Vec<_> = self.keyframes.iter().map(|kf| &kf.training).collect();
            let Some(at) = budget::most_redundant(&images, window) else { break };
            let sequence = self.keyframes[at].frame.sequence;
            tracing::info!(sequence, "mapper.max_keyframe_mib is reached: a keyframe is forgotten");
            self.forget(sequence);
        }
        before - self.len()
    }

    /// Sets the pose of a keyframe, also of a forgotten one.
    pub fn set_pose(&mut self, sequence: u64, world_from_camera: &Isometry3<f64>) {
        match self.position(sequence) {
            Some(at) => self.keyframes[at].set_pose(world_from_camera),
            None => {
                if let Some(frame) = self.forgotten.get_mut(&sequence) {
                    frame.world_from_camera = *world_from_camera;
                }
            }
        }
    }

    /// Reference keyframes for a camera at `world_from_camera`: the newest, then the oldest of those that
    /// overlap its view by at least `min_overlap`, at most `count` together. Old references keep poses from
    /// drifting. Those that are not connected are left out.
    pub fn references(
        &self,
        camera: &Camera,
        world_from_camera: &Isometry3<f64>,
        count: usize,
        min_overlap: f64,
    ) -> Vec<&Keyframe> {
        let mut connected = self.keyframes.iter().filter(|keyframe| keyframe.is_connected);
        let Some(newest) = connected.next_back() else { return Vec::new() };
        let overlaps =
            |keyframe: &&Keyframe| keyframe.overlap(camera, world_from_camera) >= min_overlap;
        std::iter::once(newest).chain(connected.filter(overlaps)).take(count).collect()
    }

    /// The `count` candidates that share most features with an image, best first; none that shares none.
    pub fn most_alike(
        &self,
        features: &Features,
        count: usize,
        is_candidate: impl Fn(&Keyframe) -> bool,
    ) -> Vec<&Keyframe> {
        self.best(count, |keyframe| {
            if is_candidate(keyframe) {
                features.similarity(&keyframe.features) as f32
            } else {
                0.0
            }
        })
    }

    /// The `count` keyframes that look most like an image, best first. Alignment decides whether one of
    /// them shows the same place.
    pub fn most_similar(&self, thumbnail: &Thumbnail, count: usize) -> Vec<&Keyframe> {
        self.best(count, |keyframe| keyframe.thumbnail.similarity(thumbnail))
    }

    /// The `count` keyframes with the highest scores above 0, best first.
    fn best(&self, count: usize, score: impl Fn(&Keyframe) -> f32) -> Vec<&Keyframe> {
        let scored = self.keyframes.iter().map(|keyframe| (score(keyframe), keyframe));
        let mut scored: Vec<(f32, &Keyframe)> = scored.filter(|(score, _)| *score > 0.0).collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        scored.into_iter().take(count).map(|(_, keyframe)| keyframe).collect()
    }
}

#[cfg(test)]
mod tests;
