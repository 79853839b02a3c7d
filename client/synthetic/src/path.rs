//! The path of a hand-held camera through a room: a loop around the middle, looking across it, with
//! gentle swings in height and direction. Poses are `world_from_camera` (camera x right, y down, z
//! forward). The speed depends on the number of frames and has a limit: few frames see only a part
//! of the loop.

use crate::dice::Dice;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A loop around a room's middle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Loop {
    pub centre: [f64; 2],
    pub radii: [f64; 2],
    pub start_radians: f64,
    pub clockwise: bool,
    phases: [f64; 4],
}

/// Longest walk, radians of the loop: the end overlaps with the start.
const FULL_RADIANS: f64 = 6.0;
/// Fastest walk, radians of the loop per frame (about 1.9 degrees).
const FASTEST_RADIANS: f64 = 0.033;

impl Loop {
    /// A loop with random start, direction and swings.
    pub fn new(centre: [f64; 2], radii: [f64; 2], dice: &mut Dice) -> Self {
        let mut angle = || f64::from(dice.between(0.0, std::f32::consts::TAU));
        let (start_radians, phases) = (angle(), [angle(), angle(), angle(), angle()]);
        Self { centre, radii, start_radians, clockwise: dice.chance(0.5), phases }
    }

    /// Poses of all frames.
    pub fn walk(&self, frames: usize) -> Vec<Isometry3<f64>> {
        let span = FULL_RADIANS.min(FASTEST_RADIANS * frames as f64);
        let step = span / (frames.max(2) - 1) as f64;
        (0..frames).map(|i| self.pose(i as f64 * step)).collect()
    }

    /// The pose after walking `way` radians of the loop.
    pub fn pose(&self, way: f64) -> Isometry3<f64> {
        let [a, b, c, d] = self.phases;
        let turn = if self.clockwise { -1.0 } else { 1.0 };
        let angle = self.start_radians + turn * way;
        let breath = 1.0 + 0.05 * (3.0 * way + a).sin();
        let position = Vector3::new(
            self.centre[0] + self.radii[0] * breath * angle.cos(),
            self.centre[1] + self.radii[1] * breath * angle.sin(),
            1.4 + 0.11 * (2.0 * way + b).sin() + 0.008 * (17.0 * way + c).sin(),
        );
        let yaw = angle
            + std::f64::consts::PI
            + 0.16 * (2.0 * way + c).sin()
            + 0.012 * (13.0 * way + a).sin();
        let pitch = -0.30 + 0.15 * (1.7 * way + d).sin() + 0.01 * (19.0 * way + b).sin();
        let roll = 0.02 * (5.0 * way + d).sin();
        let forward = Vector3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        let level =
            Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, down, forward]));
        let rotation = level * Rotation3::from_axis_angle(&Vector3::z_axis(), roll);
        Isometry3::from_parts(
            Translation3::from(position),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }
}
