//! The camera's motion around a frame, and where each pixel moves by it. Motion is taken as uniform
//! over the few hundredths of a second of an exposure. In: poses `world_from_camera`, seconds. Out:
//! pixels per second.

use super::clean::Clean;
use lexsplat_client::dataset::{Intrinsics, Moment};
use nalgebra::Vector3;

/// Frames further apart than this say nothing about the motion of an exposure, seconds.
const LONGEST_SECONDS: f64 = 0.25;
/// Depth where nothing was measured, metres: far away, so that only turning moves it.
const FAR_METRES: f32 = 100.0;

/// Velocity of the camera in its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    /// Metres per second.
    pub linear: Vector3<f64>,
    /// Radians per second.
    pub angular: Vector3<f64>,
}

impl Motion {
    /// No motion.
    pub const STILL: Self =
        Self { linear: Vector3::new(0.0, 0.0, 0.0), angular: Vector3::new(0.0, 0.0, 0.0) };

    /// The motion from one moment to a later one; still if a pose is not known, or if they are too
    /// far apart.
    pub fn between(earlier: &Moment, later: &Moment) -> Self {
        let nanos = later.timestamp_nanos.saturating_sub(earlier.timestamp_nanos);
        let seconds = nanos as f64 * 1e-9;
        let (Some(before), Some(after)) = (earlier.world_from_camera, later.world_from_camera)
        else {
            return Self::STILL;
        };
        if nanos == 0 || seconds > LONGEST_SECONDS {
            return Self::STILL;
        }
        let step = before.inv_mul(&after);
        let angular = step.rotation.scaled_axis() / seconds;
        Self { linear: step.translation.vector / seconds, angular }
    }
}

/// How each pixel moves.
#[derive(Clone, Debug)]
pub(super) struct Flow {
    width: usize,
    height: usize,
    /// Columns and rows per second, and metres of depth per second.
    velocities: Vec<[f32; 3]>,
}

impl Flow {
    /// The flow of a frame.
    pub fn of(clean: &Clean, motion: &Motion) -> Self {
        let (width, height) = (clean.width(), clean.height());
        let velocity = |(i, depth): (usize, &f32)| {
            let depth = if *depth > 0.0 { *depth } else { FAR_METRES };
            velocity(&clean.camera, motion, [(i % width) as f64, (i / width) as f64], depth)
        };
        let velocities = clean.depth.iter().enumerate().map(velocity).collect();
        Self { width, height, velocities }
    }

    /// Where the picture of the frame has what is seen at a pixel `seconds` later: two steps of a
    /// fixed point. What comes out from behind an edge is filled with what is beside it.
    pub fn source(&self, x: usize, y: usize, seconds: f32) -> [f32; 2] {
        let mut at = [x as f32, y as f32];
        for _ in 0..2 {
            let [du, dv, _] = self.velocities[self.nearest(at)];
            at = [x as f32 - seconds * du, y as f32 - seconds * dv];
        }
        at
    }

    /// The pixel nearest to a place; places outside belong to the border.
    pub fn nearest(&self, [x, y]: [f32; 2]) -> usize {
        let column = (x.round().max(0.0) as usize).min(self.width - 1);
        let row = (y.round().max(0.0) as usize).min(self.height - 1);
        row * self.width + column
    }

    /// Change of a pixel's depth, metres per second.
    pub fn approach(&self, pixel: usize) -> f32 {
        self.velocities[pixel][2]
    }

    /// Fastest pixel, pixels per second.
    pub fn fastest(&self) -> f32 {
        self.velocities.iter().map(|[u, v, _]| u.hypot(*v)).fold(0.0, f32::max)
    }
}

/// A point that is fixed in the world moves by -v - ω x X in the camera's axes.
fn velocity(camera: &Intrinsics, motion: &Motion, [u, v]: [f64; 2], depth: f32) -> [f32; 3] {
    let z = f64::from(depth);
    let (x, y) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
    let point = Vector3::new(x * z, y * z, z);
    let moved = -motion.linear - motion.angular.cross(&point);
    [
        (camera.fx * (moved.x - x * moved.z) / z) as f32,
        (camera.fy * (moved.y - y * moved.z) / z) as f32,
        moved.z as f32,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Point3};

    /// Velocities agree with the projection of a point before and after a small motion.
    #[test]
    fn velocities_are_those_of_projected_points() {
        let camera =
            Intrinsics { width: 320, height: 240, fx: 250.0, fy: 240.0, cx: 160.0, cy: 119.0 };
        let seconds = 1e-4;
        let later = Isometry3::new(
            Vector3::new(0.7, -0.3, 0.5) * seconds,
            Vector3::new(-0.4, 0.9, 0.6) * seconds,
        );
        let moment =
            |timestamp_nanos, pose| Moment { timestamp_nanos, world_from_camera: Some(pose) };
        let first = moment(5, Isometry3::identity());
        let motion = Motion::between(&first, &moment(100_005, later));
        let (pixel, z) = ([40.0, 200.0], 2.5_f32);
        let found = velocity(&camera, &motion, pixel, z);
        let ray = [(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0];
        let point = Point3::from(ray.map(|r| r * f64::from(z)));
        let seen = later.inverse_transform_point(&point);
        let u = camera.fx * seen.x / seen.z + camera.cx;
        let v = camera.fy * seen.y / seen.z + camera.cy;
        let expected = [u - pixel[0], v - pixel[1], seen.z - f64::from(z)].map(|d| d / seconds);
        for (found, expected) in found.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 0.3, "{found} for {expected}");
        }
        assert!(found[0].abs() > 50.0, "{found:?}: the motion is seen");
        let late = moment(400_000_000, later);
        assert_eq!(Motion::between(&first, &late), Motion::STILL, "frames far apart");
        let unknown = Moment { timestamp_nanos: 9, world_from_camera: None };
        assert_eq!(Motion::between(&first, &unknown), Motion::STILL);
    }
}
