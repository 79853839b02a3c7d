//! Where every tracked frame was, relative to its keyframe: when a keyframe's pose is refined, the
//! frames that were tracked after it go along.

use super::super::snapshot::TrackedFrame;
use super::super::tracker::Tracked;
use super::keyframe::Keyframe;
use nalgebra::Isometry3;

/// A tracked frame.
struct Entry {
    sequence: u64,
    timestamp_nanos: u64,
    /// The keyframe's index, and the pose in it; in the world if there is none (any more).
    keyframe: Option<usize>,
    keyframe_from_camera: Isometry3<f64>,
    exposure: [f32; 2],
}

/// Every tracked frame, in order.
#[derive(Default)]
pub(super) struct Trajectory {
    entries: Vec<Entry>,
}

impl Trajectory {
    /// A frame was tracked; its keyframe is the newest.
    pub fn push(
        &mut self,
        (sequence, timestamp_nanos): (u64, u64),
        tracked: &Tracked,
        keyframes: &[Keyframe],
    ) {
        let world_from_camera = &tracked.world_from_camera;
        let last = keyframes.last().map(|keyframe| keyframe.frame.world_from_camera);
        let keyframe_from_camera = match last {
            // The keyframe itself, exactly.
            Some(last) if last == *world_from_camera => Isometry3::identity(),
            Some(last) => last.inverse() * world_from_camera,
            None => *world_from_camera,
        };
        let keyframe = keyframes.len().checked_sub(1);
        let exposure = tracked.seen_exposure();
        self.entries.push(Entry {
            sequence,
            timestamp_nanos,
            keyframe,
            keyframe_from_camera,
            exposure,
        });
    }

    /// A keyframe is let go: the frames that were tracked after it stay where they are.
    pub fn forget(&mut self, keyframe: usize, frame: &TrackedFrame) {
        for entry in &mut self.entries {
            match entry.keyframe {
                Some(at) if at == keyframe => {
                    entry.keyframe_from_camera =
                        frame.world_from_camera * entry.keyframe_from_camera;
                    entry.keyframe = None;
                    if entry.sequence == frame.sequence {
                        entry.exposure = frame.exposure;
                    }
                }
                Some(at) if at > keyframe => entry.keyframe = Some(at - 1),
                _ => {}
            }
        }
    }

    /// All frames as of now.
    pub fn frames(&self, keyframes: &[Keyframe]) -> Vec<TrackedFrame> {
        let pose = |entry: &Entry| match entry.keyframe {
            Some(at) => keyframes[at].frame.world_from_camera * entry.keyframe_from_camera,
            None => entry.keyframe_from_camera,
        };
        // A keyframe's own exposure may have been refined since.
        let exposure = |entry: &Entry| match entry.keyframe.map(|at| &keyframes[at].frame) {
            Some(keyframe) if keyframe.sequence == entry.sequence => keyframe.exposure,
            _ => entry.exposure,
        };
        let frame = |entry: &Entry| TrackedFrame {
            sequence: entry.sequence,
            timestamp_nanos: entry.timestamp_nanos,
            world_from_camera: pose(entry),
            exposure: exposure(entry),
        };
        self.entries.iter().map(frame).collect()
    }
}
