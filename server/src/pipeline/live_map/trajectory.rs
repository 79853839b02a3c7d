//! Poses of all tracked frames, each relative to the newest keyframe of its time. When a keyframe's pose is
//! refined, the frames that were tracked after it move with it.

use super::super::frame::{Frame, PoseHint, TrackedFrame, TrackedPose};
use super::super::keyframes::KeyframeStore;
use nalgebra::{Isometry3, UnitVector3};
use serde::{Deserialize, Serialize};

#[derive(Clone, Serialize, Deserialize)]
struct Entry {
    /// The frame with the pose and exposure it was tracked with.
    frame: TrackedFrame,
    /// Sequence number of the keyframe, if there was one.
    keyframe: Option<u64>,
    /// The pose in the keyframe's camera; in the world if there is no keyframe.
    keyframe_from_camera: Isometry3<f64>,
    /// The direction up in the camera's coordinates, if it was measured.
    up: Option<UnitVector3<f64>>,
}

/// All tracked frames in order of their sequence numbers.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(in super::super) struct Trajectory {
    entries: Vec<Entry>,
    /// The direction up in the map's coordinates, as the sender of the newest frame that has one says.
    given_up: Option<UnitVector3<f64>>,
}

impl Trajectory {
    /// Adds a tracked frame, after its keyframe was added to the store if it became one.
    pub fn push(&mut self, frame: &Frame, tracked: &TrackedPose, keyframes: &KeyframeStore) {
        let pose = &tracked.world_from_camera;
        let keyframe = keyframes.newest().map(|keyframe| &keyframe.frame);
        let keyframe_from_camera = match keyframe.map(|frame| frame.world_from_camera) {
            // Exactly the identity for the keyframe itself.
            Some(keyframe) if keyframe == *pose => Isometry3::identity(),
            Some(keyframe) => keyframe.inverse() * pose,
            None => *pose,
        };
        if frame.up.in_world.is_some() && self.shares_world(frame) {
            self.given_up = frame.up.in_world;
        }
        self.entries.push(Entry {
            frame: TrackedFrame::new(frame, tracked),
            keyframe: keyframe.map(|frame| frame.sequence),
            keyframe_from_camera,
            up: frame.up.in_camera,
        });
    }

    /// Whether the sender's coordinates are those of the map: its poses are given, or hints that the map follows
    /// or begins at.
    fn shares_world(&self, frame: &Frame) -> bool {
        let follows = |hint: &PoseHint| hint.covariance.is_some() || self.entries.is_empty();
        frame.world_from_camera.is_some() || frame.hint.as_deref().is_some_and(follows)
    }

    /// The direction up in the map's coordinates, if a sender said it.
    pub fn given_up(&self) -> Option<UnitVector3<f64>> {
        self.given_up
    }

    /// Directions up that were measured with frames, in the map's coordinates.
    pub fn measured_ups(&self, keyframes: &KeyframeStore) -> Vec<UnitVector3<f64>> {
        let measured = |entry: &Entry| {
            let up = entry.up?;
            Some(entry.current(keyframes).world_from_camera.rotation * up)
        };
        self.entries.iter().filter_map(measured).collect()
    }

    /// All frames with their current poses. A keyframe also has its current exposure.
    pub fn frames(&self, keyframes: &KeyframeStore) -> Vec<TrackedFrame> {
        self.entries.iter().map(|entry| entry.current(keyframes)).collect()
    }
}

impl Entry {
    fn current(&self, keyframes: &KeyframeStore) -> TrackedFrame {
        let Some(keyframe) = self.keyframe.and_then(|sequence| keyframes.frame(sequence)) else {
            return TrackedFrame { world_from_camera: self.keyframe_from_camera, ..self.frame };
        };
        let is_keyframe = keyframe.sequence == self.frame.sequence;
        TrackedFrame {
            world_from_camera: keyframe.world_from_camera * self.keyframe_from_camera,
            exposure: if is_keyframe { keyframe.exposure } else { self.frame.exposure },
            ..self.frame
        }
    }
}
