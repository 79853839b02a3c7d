//! The ways in which poses and depth may have been meant.
//!
//! A [`Reading`] says what the sender's numbers would have to be for the frames to make sense: poses
//! inverted or not, the axes of the camera, and a factor on the depth.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion};

/// Wide steps between factors; a wrong reading must differ more than by that.
const WIDE_STEP: f32 = 1.25;
/// Number of wide steps up and down: four times beyond factors of 1000.
const WIDE_STEPS: i32 = 38;
/// Factors near 1, beside those of the wide steps.
const NEAR: [f32; 4] = [1.0 / 1.12, 1.0 / 1.06, 1.06, 1.12];

/// The axes of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axes {
    /// x right, y down, z forward, as it should be.
    Optical,
    /// x right, y up, z backward: OpenGL, Blender, ARKit.
    OpenGl,
    /// x forward, y left, z up: a ROS body.
    Body,
}

impl Axes {
    /// The rotation from optical axes to these.
    fn axes_from_optical(self) -> UnitQuaternion<f64> {
        let matrix = match self {
            Self::Optical => Matrix3::identity(),
            Self::OpenGl => Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0),
            Self::Body => Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0),
        };
        Rotation3::from_matrix_unchecked(matrix).into()
    }
}

/// How poses may have been meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Convention {
    /// Whether the poses are `camera_from_world`.
    pub inverted: bool,
    pub axes: Axes,
}

/// All conventions; the first is the right one.
pub(super) const CONVENTIONS: [Convention; 6] = [
    Convention { inverted: false, axes: Axes::Optical },
    Convention { inverted: true, axes: Axes::Optical },
    Convention { inverted: false, axes: Axes::OpenGl },
    Convention { inverted: true, axes: Axes::OpenGl },
    Convention { inverted: false, axes: Axes::Body },
    Convention { inverted: true, axes: Axes::Body },
];

impl Convention {
    /// Whether poses are as they should be.
    pub fn is_right(self) -> bool {
        self == CONVENTIONS[0]
    }

    /// The pose of a camera with optical axes, from the pose as sent.
    pub fn world_from_camera(&self, sent: &Isometry3<f64>) -> Isometry3<f64> {
        let world_from_axes = if self.inverted { sent.inverse() } else { *sent };
        world_from_axes * self.axes.axes_from_optical()
    }
}

/// A reading of the sender's numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    pub convention: Convention,
    /// Depth as sent times this is in the unit of the poses.
    pub depth_factor: f32,
}

/// The factors of depth that are tried, from small to large.
pub(super) fn depth_factors() -> Vec<f32> {
    let wide = (-WIDE_STEPS..=WIDE_STEPS).map(|step| WIDE_STEP.powi(step));
    let mut factors: Vec<f32> = wide.chain(NEAR).collect();
    factors.sort_by(f32::total_cmp);
    factors
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn a_convention_undoes_what_the_sender_did() {
        let truth = Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 0.9, -0.4));
        for convention in CONVENTIONS {
            let axes = truth * convention.axes.axes_from_optical().inverse();
            let sent = if convention.inverted { axes.inverse() } else { axes };
            let read = convention.world_from_camera(&sent);
            assert!((read.to_matrix() - truth.to_matrix()).norm() < 1e-9, "{convention:?}");
            let others = CONVENTIONS.iter().filter(|other| **other != convention);
            for other in others {
                let wrong = other.world_from_camera(&sent);
                let is_off = (wrong.to_matrix() - truth.to_matrix()).norm() > 0.1;
                assert!(is_off, "{other:?} is not {convention:?}");
            }
        }
    }

    #[test]
    fn axes_are_what_their_names_say() {
        let forward = Point3::new(0.0, 0.0, 1.0);
        let down = Point3::new(0.0, 1.0, 0.0);
        let of = |axes: Axes, point| axes.axes_from_optical() * point;
        assert!((of(Axes::OpenGl, forward) - Point3::new(0.0, 0.0, -1.0)).norm() < 1e-9);
        assert!((of(Axes::OpenGl, down) - Point3::new(0.0, -1.0, 0.0)).norm() < 1e-9);
        assert!((of(Axes::Body, forward) - Point3::new(1.0, 0.0, 0.0)).norm() < 1e-9);
        assert!((of(Axes::Body, down) - Point3::new(0.0, 0.0, -1.0)).norm() < 1e-9);
    }

    #[test]
    fn factors_are_sorted_and_have_the_identity() {
        let factors = depth_factors();
        assert!(factors.is_sorted() && factors.contains(&1.0), "{factors:?}");
        assert!(factors[0] < 0.000_25 && factors.last().is_some_and(|last| *last > 4000.0));
    }
}
