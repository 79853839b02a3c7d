//! Turning a map so that an axis of the file points up.
//!
//! In: a snapshot with its direction up, and an axis. Out: the rotation about the map's origin, and the
//! turned snapshot: Gaussians, keyframes and trajectory. Nothing is moved or scaled.

use crate::pipeline::frame::TrackedFrame;
use crate::pipeline::snapshot::{KeyframeInfo, MapSnapshot};
use crate::pipeline::up::MapUp;
use lexsplat_gpu::{HostGaussians, HostHead};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3};
use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::Arc;

/// Which way is up in an exported file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FileUp {
    /// As in the map's own coordinates.
    Map,
    /// Along an axis of the file.
    Axis(UnitVector3<f64>),
}

impl FileUp {
    /// `map`, `x`, `y`, `z`, `-x`, `-y` or `-z`.
    pub fn named(name: &str) -> Option<Self> {
        let (sign, axis) = name.strip_prefix('-').map_or((1.0, name), |axis| (-1.0, axis));
        let axis = match (sign, axis) {
            (1.0, "map") => return Some(Self::Map),
            (_, "x") => Vector3::x(),
            (_, "y") => Vector3::y(),
            (_, "z") => Vector3::z(),
            _ => return None,
        };
        Some(Self::Axis(UnitVector3::new_unchecked(axis * sign)))
    }

    /// What it is before the writer of SPZ negates y and z.
    pub(super) fn for_spz(self) -> Self {
        match self {
            Self::Map => Self::Map,
            Self::Axis(axis) => {
                Self::Axis(UnitVector3::new_unchecked(Vector3::new(axis.x, -axis.y, -axis.z)))
            }
        }
    }
}

/// The rotation that takes up in the map to up in the file. Quarter turns bring the map's nearest axis
/// there, and the smallest rotation brings up itself there; so a small change of up never turns a file
/// about its up.
pub(super) fn turn(map: &MapSnapshot, file: FileUp) -> UnitQuaternion<f64> {
    match (&map.up, file) {
        (Some(up), FileUp::Axis(axis)) => to_axis(up.direction, axis),
        _ => UnitQuaternion::identity(),
    }
}

fn to_axis(up: UnitVector3<f64>, axis: UnitVector3<f64>) -> UnitQuaternion<f64> {
    let nearest = UnitVector3::new_unchecked({
        let at = up.iamax();
        Vector3::ith(at, up[at].signum())
    });
    let across = if axis.x == 0.0 { Vector3::x_axis() } else { Vector3::z_axis() };
    let between = |from: UnitVector3<f64>, to: UnitVector3<f64>| {
        UnitQuaternion::rotation_between_axis(&from, &to)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&across, PI))
    };
    let quarters = between(nearest, axis);
    between(quarters * up, axis) * quarters
}

/// The map in the coordinates of the file.
pub(super) fn turned(map: &MapSnapshot, up: FileUp) -> Cow<'_, MapSnapshot> {
    match up {
        FileUp::Map => Cow::Borrowed(map),
        FileUp::Axis(_) => Cow::Owned(turned_by(&turn(map, up), map)),
    }
}

fn turned_by(turn: &UnitQuaternion<f64>, map: &MapSnapshot) -> MapSnapshot {
    let around = Isometry3::from_parts(Translation3::identity(), *turn);
    let frame = |frame: &TrackedFrame| TrackedFrame {
        world_from_camera: around * frame.world_from_camera,
        ..*frame
    };
    let keyframe = |info: &KeyframeInfo| KeyframeInfo { frame: frame(&info.frame), ..info.clone() };
    MapSnapshot {
        gaussians: Arc::new(turned_gaussians(&map.gaussians, turn)),
        trajectory: Arc::new(map.trajectory.iter().map(frame).collect()),
        keyframes: Arc::new(map.keyframes.iter().map(keyframe).collect()),
        up: map.up.map(|up| MapUp { direction: turn * up.direction, ..up }),
        ..map.clone()
    }
}

/// Means and the rotations of both heads. Colors do not depend on the view.
fn turned_gaussians(gaussians: &HostGaussians, turn: &UnitQuaternion<f64>) -> HostGaussians {
    let mean = |mean: &[f32; 3]| (turn * Point3::from(*mean).cast::<f64>()).cast::<f32>().into();
    let rotation = |[w, x, y, z]: &[f32; 4]| {
        let turned = turn.quaternion() * Quaternion::new(*w, *x, *y, *z).cast::<f64>();
        [turned.w, turned.i, turned.j, turned.k].map(|part| part as f32)
    };
    let head = |head: &HostHead| HostHead {
        rotations: head.rotations.iter().map(rotation).collect(),
        ..head.clone()
    };
    HostGaussians {
        means: gaussians.means.iter().map(mean).collect(),
        color: head(&gaussians.color),
        language: head(&gaussians.language),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;

    const AXES: [&str; 6] = ["x", "y", "z", "-x", "-y", "-z"];

    fn axis(name: &str) -> UnitVector3<f64> {
        match FileUp::named(name).unwrap() {
            FileUp::Map => panic!("{name} is no axis"),
            FileUp::Axis(axis) => axis,
        }
    }

    #[test]
    fn up_goes_to_the_axis_from_everywhere() {
        for (to, from) in AXES.iter().flat_map(|to| AXES.map(|from| (axis(to), axis(from)))) {
            for off in [Vector3::zeros(), Vector3::new(0.3, -0.2, 0.1)] {
                let up = UnitVector3::new_normalize(*from + off);
                let found = to_axis(up, to) * up;
                assert!((*found - *to).norm() < 1e-12, "{to:?} from {up:?}");
            }
        }
    }

    #[test]
    fn a_small_change_of_up_never_turns_a_file_about_its_up() {
        let ahead = |off: Vector3<f64>| {
            let up = UnitVector3::new_normalize(-Vector3::y() + off);
            to_axis(up, axis("y")) * Vector3::z()
        };
        // As in glTF: right stays right, ahead becomes -z.
        assert!((ahead(Vector3::zeros()) + Vector3::z()).norm() < 1e-12);
        for off in [Vector3::x() * 1e-3, -Vector3::x() * 1e-3, Vector3::z() * 1e-3] {
            assert!((ahead(off) + Vector3::z()).norm() < 3e-3, "{off:?}");
        }
        // The smallest rotation between nearly opposite directions depends on the noise.
        let smallest = |off: Vector3<f64>| {
            UnitQuaternion::rotation_between(&(-Vector3::y() + off), &Vector3::y()).unwrap()
                * Vector3::z()
        };
        assert!((smallest(Vector3::x() * 1e-3) + Vector3::z()).norm() > 1.0);
        // ROS, z up, as glTF has it.
        let ros = to_axis(Vector3::z_axis(), axis("y"));
        assert!((ros * Vector3::x() - Vector3::x()).norm() < 1e-12);
        assert!((ros * Vector3::y() + Vector3::z()).norm() < 1e-12);
    }

    #[test]
    fn gaussians_turn_as_a_whole() {
        let turn = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0);
        let (before, after) = (two(), turned_gaussians(&two(), &turn));
        let point = |of: &HostGaussians, at: usize| Point3::from(of.means[at]).cast::<f64>();
        let axes = |head: &HostHead, at: usize| {
            let [w, x, y, z] = head.rotations[at].map(f64::from);
            UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix()
        };
        for at in 0..2 {
            assert!((turn * point(&before, at) - point(&after, at)).norm() < 1e-5);
            for head in
                [|of: &HostGaussians| of.color.clone(), |of: &HostGaussians| of.language.clone()]
            {
                let expected = turn.to_rotation_matrix() * axes(&head(&before), at);
                let off = expected.matrix() - axes(&head(&after), at).matrix();
                assert!(off.norm() < 1e-5, "{off}");
            }
        }
        assert_eq!(after.color.features, before.color.features);
        assert_eq!(after.color.log_scales, before.color.log_scales);
    }
}
