//! Relations between shapes that do not depend on where one looks from.

use super::nearness::is_near;
use super::shape::Shape;
use crate::pipeline::query::question::RelationKind;
use nalgebra::{Point3, Vector2};

/// Distance at which surfaces touch, metres: twice the distance of a shape's points.
const TOUCH_METRES: f32 = 0.1;
/// What hangs on something is as high above its foot, metres. A chair that stands at a wall does not hang
/// on it.
const HANG_METRES: f32 = 0.2;
/// Part of the smaller footprint that two things share of which one is above the other.
const SHARED: f32 = 0.3;
/// Cells of a footprint that two things may lie beside each other, where the upper one stands on the floor,
/// and where it is higher than the lower one.
const BESIDE_STANDING: i32 = 1;
const BESIDE_HANGING: i32 = 3;
/// Uncertainty of heights, metres.
const HEIGHT_METRES: f32 = 0.05;
/// Part of a thing that lies in the box of what it is in.
const INSIDE: f32 = 0.6;
/// From a thing that is between two others, they lie in directions that differ by more than this, radians:
/// 120 degrees.
const APART_RADIANS: f32 = 2.1;

/// Whether `a` has the relation to `b`. Relations of another kind hold never.
pub(super) fn holds(kind: RelationKind, a: &Shape, b: &Shape) -> bool {
    match kind {
        RelationKind::Near => is_near(a, b),
        RelationKind::On => is_on(a, b),
        RelationKind::In => is_in(a, b),
        RelationKind::With => is_on(b, a) || is_in(b, a),
        RelationKind::Under => is_above(b, a),
        RelationKind::Above => is_above(a, b),
        _ => false,
    }
}

/// Whether `a` rests on `b`, or hangs on it. What `a` rests on touches it from below. What it hangs on touches
/// it from the side, and is higher and lower than `a`.
fn is_on(a: &Shape, b: &Shape) -> bool {
    let mut heights = touching(b, a);
    if heights.is_empty() {
        return false;
    }
    heights.sort_by(f32::total_cmp);
    let most = heights[heights.len() * 3 / 4];
    let middle = a.center().z;
    let rests = most < middle + HEIGHT_METRES / 2.0;
    let hangs = b.low.z + HANG_METRES < a.low.z && middle < b.high.z;
    rests || hangs
}

/// Heights of the points of `b` that touch `a`.
fn touching(b: &Shape, a: &Shape) -> Vec<f32> {
    let reach = nalgebra::Vector3::repeat(TOUCH_METRES);
    let (low, high) = (a.low - reach, a.high + reach);
    let is_close =
        |point: &&Point3<f32>| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
    let touches = |point: &&Point3<f32>| {
        a.points.iter().any(|other| (other - **point).norm_squared() < TOUCH_METRES * TOUCH_METRES)
    };
    b.points.iter().filter(is_close).filter(touches).map(|point| point.z).collect()
}

fn is_in(a: &Shape, b: &Shape) -> bool {
    let margin = nalgebra::Vector3::repeat(HEIGHT_METRES);
    let (low, high) = (b.low - margin, b.high + margin);
    let inside =
        |point: &&Point3<f32>| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
    let count = a.points.iter().filter(inside).count();
    a.diagonal() < b.diagonal() && count as f32 >= INSIDE * a.points.len() as f32
}

/// Whether `a` is above `b`, at whatever distance. A table that stands on the floor is above what lies within
/// its footprint. A picture is above a sofa that stands a little in front of the wall.
fn is_above(a: &Shape, b: &Shape) -> bool {
    let is_higher = a.center().z > b.center().z && a.high.z > b.high.z - HEIGHT_METRES;
    let beside = if a.low.z < b.high.z - HEIGHT_METRES { BESIDE_STANDING } else { BESIDE_HANGING };
    is_higher && a.overlap(b, beside) >= SHARED
}

/// Whether `a` is between `b` and `c`: the directions to their nearest points are nearly opposite.
pub(super) fn is_between(a: &Shape, b: &Shape, c: &Shape) -> bool {
    let center = a.center();
    let towards = |other: &Shape| -> Option<Vector2<f32>> {
        let level = |point: &Point3<f32>| (point - center).xy();
        let nearest = other.points.iter().map(level).min_by(|p, q| p.norm().total_cmp(&q.norm()));
        nearest.filter(|direction| direction.norm() > 1e-3)
    };
    match (towards(b), towards(c)) {
        (Some(first), Some(second)) => first.angle(&second) > APART_RADIANS,
        _ => false,
    }
}
