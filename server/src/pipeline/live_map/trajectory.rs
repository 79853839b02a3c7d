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

    /// Whether the sender's coordinates are those of the map: its poses are given, or hints that the map
    /// follows or begins at.
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

#[cfg(test)]
mod tests {
    use super::super::super::frame::FrameUp;
    use super::*;
    use crate::test_support::pixel_frame;
    use nalgebra::{Matrix6, Vector3};

    /// A frame whose stream says what is up.
    fn says(up: UnitVector3<f64>) -> Frame {
        Frame { up: FrameUp { in_world: Some(up), in_camera: None }, ..pixel_frame() }
    }

    fn hint(covariance: Option<Matrix6<f64>>) -> Option<Box<PoseHint>> {
        Some(Box::new(PoseHint { world_from_camera: Isometry3::identity(), covariance }))
    }

    fn tracked(world_from_camera: Isometry3<f64>) -> TrackedPose {
        TrackedPose {
            world_from_camera,
            covariance: None,
            exposure: [0.0; 2],
            is_estimated: true,
            relocalised: false,
            beside: None,
        }
    }

    fn given_up(frames: impl IntoIterator<Item = Frame>) -> Option<UnitVector3<f64>> {
        let tracked = tracked(Isometry3::identity());
        let mut trajectory = Trajectory::default();
        for frame in frames {
            trajectory.push(&frame, &tracked, &KeyframeStore::default());
        }
        trajectory.given_up()
    }

    #[test]
    fn who_knows_the_maps_coordinates_may_say_what_is_up() {
        let (x, z) = (Vector3::x_axis(), Vector3::z_axis());
        let posed = |up| Frame { world_from_camera: Some(Isometry3::identity()), ..says(up) };
        let vague = |up| Frame { hint: hint(None), ..says(up) };
        let sure = |up| Frame { hint: hint(Some(Matrix6::identity())), ..says(up) };
        assert_eq!(given_up([pixel_frame()]), None);
        assert_eq!(given_up([posed(z), pixel_frame()]), Some(z));
        assert_eq!(given_up([posed(z), posed(x)]), Some(x), "the newest");
        // The map begins at the hint of its first frame.
        assert_eq!(given_up([vague(z)]), Some(z));
        // Later, a hint that is not followed may be in any coordinates.
        assert_eq!(given_up([pixel_frame(), vague(z)]), None);
        assert_eq!(given_up([vague(z), vague(x)]), Some(z));
        assert_eq!(given_up([pixel_frame(), sure(z)]), Some(z));
    }

    #[test]
    fn measured_directions_turn_with_the_camera() {
        let up = Some(-Vector3::y_axis());
        let frame = Frame { up: FrameUp { in_world: None, in_camera: up }, ..pixel_frame() };
        let turn = Vector3::x() * std::f64::consts::FRAC_PI_2;
        let tracked = tracked(Isometry3::rotation(turn));
        let keyframes = KeyframeStore::default();
        let mut trajectory = Trajectory::default();
        trajectory.push(&frame, &tracked, &keyframes);
        trajectory.push(&pixel_frame(), &tracked, &keyframes);
        let found = trajectory.measured_ups(&keyframes);
        assert!(found.len() == 1 && (*found[0] + Vector3::z()).norm() < 1e-12, "{found:?}");
    }
}
