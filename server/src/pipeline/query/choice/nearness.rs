//! How near two objects are.

use super::shape::Shape;

/// Share of the smaller object's points that must be as near for a distance to count, so that single points
/// that belong to the other object do not.
const COUNTED: f32 = 0.03;
/// The least and the largest gap between things next to each other, metres.
const GAP_METRES: [f32; 2] = [0.25, 1.0];
/// The same as a share of the mean diagonal of both: a chair is next to a table from farther away than a cup
/// next to a plate.
const GAP_SHARE: f32 = 0.5;

/// The gap between two objects, metres.
pub(super) fn gap(a: &Shape, b: &Shape) -> f32 {
    let (small, large) = if a.points.len() <= b.points.len() { (a, b) } else { (b, a) };
    let nearest = |point: &nalgebra::Point3<f32>| {
        let squares = large.points.iter().map(|other| (other - point).norm_squared());
        squares.fold(f32::INFINITY, f32::min)
    };
    let mut squares: Vec<f32> = small.points.iter().map(nearest).collect();
    squares.sort_by(f32::total_cmp);
    let counted = (squares.len() as f32 * COUNTED) as usize;
    squares.get(counted).map_or(f32::INFINITY, |square| square.sqrt())
}

/// Whether two objects are next to each other.
pub(super) fn is_near(a: &Shape, b: &Shape) -> bool {
    let [least, most] = GAP_METRES;
    let mean = (a.diagonal() + b.diagonal()) / 2.0;
    gap(a, b) <= (GAP_SHARE * mean).clamp(least, most)
}
