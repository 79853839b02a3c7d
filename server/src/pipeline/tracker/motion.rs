//! Constant-velocity prediction of the next pose.
//!
//! In: tracked poses with their times. Out: the pose on the same screw motion after the next interval. Lost
//! frames are not added, so they do not change the velocity.

use super::super::frame::Frame;
use super::frame_aligner::distance;
use lexsplat_gpu::align::se3;
use nalgebra::{Isometry3, Vector6};
use serde::{Deserialize, Serialize};

/// Most frames that a prediction bridges at full speed. After a longer pause the camera may have turned
/// back.
pub(super) const SHORT_PAUSE: f64 = 3.0;
/// Most frames that a prediction bridges at all.
pub(super) const LONG_PAUSE: f64 = 45.0;

/// Longest time between two poses that tells the velocity between them, nanoseconds.
const LONGEST_INTERVAL: u64 = 500_000_000;

/// Where the camera is expected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    pub world_from_camera: Isometry3<f64>,
    /// Distance by which it may be elsewhere if it only speeds up or stops, metres; infinite if its
    /// velocity is not known.
    pub metres: f64,
    /// The same of its rotation, radians.
    pub radians: f64,
}

/// The newest tracked pose and the motion that led to it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Motion {
    last: Option<(Isometry3<f64>, u64)>,
    /// Twist from the pose before to the last one, in the camera's frame, and its duration in nanoseconds.
    velocity: Option<(Vector6<f64>, u64)>,
}

impl Motion {
    /// The newest tracked pose.
    pub fn last(&self) -> Option<Isometry3<f64>> {
        self.last.map(|(pose, _)| pose)
    }

    /// Predicts `world_from_camera` at a time, at most `longest` frames ahead; `None` before the first pose.
    pub fn predict(&self, nanos: u64, longest: f64) -> Option<Isometry3<f64>> {
        let (pose, since) = self.last?;
        let Some((twist, interval)) = self.velocity else { return Some(pose) };
        let pause = nanos.saturating_sub(since) as f64;
        let share =
            if interval > 0 && pause > 0.0 { (pause / interval as f64).min(longest) } else { 1.0 };
        Some(pose * se3::exp(&(twist * share)))
    }

    /// As [`Motion::predict`], with how far the camera may be from there.
    pub fn expect(&self, nanos: u64, longest: f64) -> Option<Expected> {
        let world_from_camera = self.predict(nanos, longest)?;
        let (metres, radians) = match (self.last(), self.velocity) {
            (Some(last), Some(_)) => distance(&last, &world_from_camera),
            _ => (f64::INFINITY, f64::INFINITY),
        };
        Some(Expected { world_from_camera, metres, radians })
    }

    /// Where the camera was, or will be, `lag_nanos` after a frame, in the coordinates of the camera of
    /// that frame: by the motion from the last pose to the frame's own one if that is given, else by the
    /// motion before. `None` if neither is known.
    pub fn during(&self, frame: &Frame, lag_nanos: i64) -> Option<Isometry3<f64>> {
        let (twist, interval) = match (frame.world_from_camera, self.last) {
            (Some(given), Some((last, since))) => {
                let interval = frame.timestamp_nanos.saturating_sub(since);
                (se3::log(&(last.inverse() * given)), interval)
            }
            (Some(_), None) => return None,
            (None, _) => self.velocity?,
        };
        // After a longer pause the velocity says nothing of the moment of the exposure.
        (1..=LONGEST_INTERVAL)
            .contains(&interval)
            .then(|| se3::exp(&(twist * (lag_nanos as f64 / interval as f64))))
    }

    /// Adds a tracked frame whose predecessor was tracked too.
    pub fn follow(&mut self, world_from_camera: Isometry3<f64>, nanos: u64) {
        self.velocity = self.last.map(|(last, since)| {
            let twist = se3::log(&(last.inverse() * world_from_camera));
            (twist, nanos.saturating_sub(since))
        });
        self.last = Some((world_from_camera, nanos));
    }

    /// The map was moved by `moved_from_world`, and the camera with it. The velocity is relative to the
    /// camera.
    pub fn move_by(&mut self, moved_from_world: &Isometry3<f64>) {
        self.last = self.last.map(|(pose, nanos)| (moved_from_world * pose, nanos));
    }

    /// Sets the pose after a jump: its velocity is unknown.
    pub fn restart(&mut self, world_from_camera: Isometry3<f64>, nanos: u64) {
        *self = Self { last: Some((world_from_camera, nanos)), velocity: None };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::pixel_frame;

    fn screw(times: f64) -> Isometry3<f64> {
        se3::exp(&(Vector6::new(0.03, -0.01, 0.02, 0.02, 0.05, -0.03) * times))
    }

    fn off(motion: &Motion, nanos: u64, wanted: &Isometry3<f64>) -> f64 {
        let found = motion.predict(nanos, SHORT_PAUSE).expect("a pose is known");
        (found.to_homogeneous() - wanted.to_homogeneous()).norm()
    }

    #[test]
    fn a_screw_goes_on() {
        let mut motion = Motion::default();
        assert!(motion.predict(0, SHORT_PAUSE).is_none());
        motion.follow(screw(0.0), 0);
        assert!(off(&motion, 10, &screw(0.0)) < 1e-12, "one pose has no velocity");
        motion.follow(screw(1.0), 10);
        assert!(off(&motion, 20, &screw(2.0)) < 1e-9);
        assert!(off(&motion, 30, &screw(3.0)) < 1e-9, "a frame is missing");
        assert!(off(&motion, 20, &screw(1.0)) > 0.03, "and standing still is another answer");
        assert!(off(&motion, 10_000, &screw(4.0)) < 1e-9, "a long pause is cut");
        assert!(off(&motion, 10, &screw(2.0)) < 1e-9, "without times, one frame is one step");
        let moved = Isometry3::rotation(nalgebra::Vector3::new(0.1, 0.2, -0.3));
        motion.move_by(&moved);
        assert!(
            off(&motion, 30, &(moved * screw(3.0))) < 1e-9,
            "the map and the camera were moved"
        );
        let expected = motion.expect(30, SHORT_PAUSE).expect("a pose is known");
        let (metres, radians) = distance(&screw(1.0), &screw(3.0));
        assert!((expected.metres - metres).abs() + (expected.radians - radians).abs() < 1e-9);
        motion.restart(screw(5.0), 20);
        assert!(off(&motion, 30, &screw(5.0)) < 1e-12, "a restart stands still");
        let expected = motion.expect(30, SHORT_PAUSE).expect("a pose is known");
        assert!(expected.metres.is_infinite(), "and says nothing of the velocity");
    }

    #[test]
    fn the_moment_of_depth_is_on_the_same_screw() {
        let frame = |nanos: u64, world_from_camera: Option<Isometry3<f64>>| Frame {
            sequence: 1,
            timestamp_nanos: nanos,
            world_from_camera,
            ..pixel_frame()
        };
        let off = |found: Option<Isometry3<f64>>, wanted: Isometry3<f64>| {
            (found.expect("it is known").to_homogeneous() - wanted.to_homogeneous()).norm()
        };
        let mut motion = Motion::default();
        assert!(motion.during(&frame(0, Some(screw(0.0))), 5).is_none());
        motion.follow(screw(0.0), 0);
        assert!(motion.during(&frame(10, None), 5).is_none());
        // A given pose tells its own velocity, an estimated one has that of the frame before.
        assert!(off(motion.during(&frame(10, Some(screw(1.0))), 5), screw(0.5)) < 1e-9);
        motion.follow(screw(1.0), 10);
        assert!(off(motion.during(&frame(20, None), -5), screw(-0.5)) < 1e-9);
        assert!(motion.during(&frame(2 * LONGEST_INTERVAL, Some(screw(1.0))), 5).is_none());
    }
}
