//! Moves Gaussians rigidly, each with its owner.
//!
//! In: rows of means and of both heads' geometry, and a motion for each owner. Out: the rows moved: a mean
//! m becomes R m + t, a rotation q becomes R q. The owner is in the fourth number of a mean's row, where
//! no kernel looks and which every move of the row carries along. Scales, opacities and features stay.
//!
//! This happens on the host in f64, since it is rare.

use nalgebra::{Isometry3, Point3, Quaternion};

use crate::shader::layout::Row;

/// Largest owner that an f32 holds exactly.
pub(super) const MAX_OWNER: u32 = 1 << 24;

/// The owner that a row of the means names.
pub(super) fn owner(mean: &Row) -> u32 {
    mean[3] as u32
}

/// Moves a mean's row.
pub(super) fn move_mean(mean: &mut Row, motion: &Isometry3<f64>) {
    let moved = motion * Point3::new(mean[0], mean[1], mean[2]).cast::<f64>();
    for axis in 0..3 {
        mean[axis] = moved[axis] as f32;
    }
}

/// Turns a quaternion (w, x, y, z), which keeps its length.
pub(super) fn turn(rotation: &mut Row, motion: &Isometry3<f64>) {
    let [w, x, y, z] = rotation.map(f64::from);
    let turned = motion.rotation.quaternion() * Quaternion::new(w, x, y, z);
    *rotation = [turned.w, turned.i, turned.j, turned.k].map(|value| value as f32);
}
