//! Segments of a map: connected pieces of surface of similar color and direction, cut without words.
//!
//! A word is often a little relevant to a part of something else: to a corner of the bed, to a patch
//! of the floor. Such a patch ends in the middle of a surface, while a thing ends where its surface
//! does. So the share of a cluster's segments that is relevant, too, tells things from patches.
//!
//! The cut is that of P. Felzenszwalb and D. Huttenlocher, "Efficient graph-based image segmentation"
//! (2004), on touching Gaussians instead of pixels. Edges are taken by increasing difference. An edge
//! joins two segments if its difference is at most the largest one inside each of them, plus a
//! tolerance that shrinks with their size. The difference is the distance of the colors plus a
//! multiple of 1 - |cosine of the normals|. Normals are the shortest axes of the color head.

use super::gaussian::RelevantGaussian;
use super::neighbours::Neighbours;
use crate::pipeline::query::disjoint_sets::DisjointSets;
use lexsplat_gpu::{HostGaussians, HostHead};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rayon::prelude::*;

/// Gaussians touch if the gap between their balls is below this, metres.
const TOUCH_METRES: f32 = 0.01;
/// Difference of two surfaces at a right angle; colors differ by up to the root of 3.
const RIGHT_ANGLE: f32 = 0.28;
/// Tolerance of a segment of one Gaussian; that of n Gaussians is an n-th of it.
const TOLERANCE: f32 = 1.0;
/// The segment of Gaussians that belong to none.
const NONE: u32 = u32::MAX;

/// The segments of one snapshot.
pub(super) struct Segments {
    /// The segment of each Gaussian of the map.
    segment_of: Vec<u32>,
    /// Sum of the opacities in each segment.
    weights: Vec<f32>,
}

impl Segments {
    /// Cuts a map; `opaque` are its Gaussians that can belong to objects.
    pub(super) fn new(gaussians: &HostGaussians, opaque: &[RelevantGaussian]) -> Self {
        let near = Neighbours::new(opaque, TOUCH_METRES);
        let surfaces: Vec<Surface> =
            opaque.iter().map(|one| Surface::of(&gaussians.color, one.row as usize)).collect();
        let edge = |[a, b]: [u32; 2]| {
            let difference = surfaces[a as usize].difference(&surfaces[b as usize]);
            Edge { difference, ends: [a, b] }
        };
        let edges = near.pairs().into_par_iter().map(edge).collect();
        let mut segment_of = vec![NONE; gaussians.len()];
        let mut weights = vec![0.0; opaque.len()];
        for (one, segment) in opaque.iter().zip(cut(opaque.len(), edges)) {
            segment_of[one.row as usize] = segment as u32;
            weights[segment] += one.opacity;
        }
        Self { segment_of, weights }
    }

    /// For each relevant Gaussian, the share of its segment that is relevant, 0..1, by opacity.
    pub(super) fn relevant_shares(&self, relevant: &[RelevantGaussian]) -> Vec<f32> {
        let mut sums = vec![0.0; self.weights.len()];
        let segment = |one: &RelevantGaussian| self.segment_of[one.row as usize] as usize;
        relevant.iter().for_each(|one| sums[segment(one)] += one.opacity);
        relevant.iter().map(|one| sums[segment(one)] / self.weights[segment(one)]).collect()
    }
}

/// A piece of surface.
struct Surface {
    color: Vector3<f32>,
    normal: Vector3<f32>,
}

impl Surface {
    fn of(head: &HostHead, row: usize) -> Self {
        let color = Vector3::from_fn(|channel, _| head.features[3 * row + channel]);
        let [w, x, y, z] = head.rotations[row];
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let shortest = Vector3::from(head.log_scales[row]).imin();
        Self { color, normal: rotation * Vector3::ith(shortest, 1.0) }
    }

    fn difference(&self, other: &Self) -> f32 {
        let bend = 1.0 - self.normal.dot(&other.normal).abs();
        (self.color - other.color).norm() + RIGHT_ANGLE * bend
    }
}

/// Two Gaussians that touch.
#[derive(Clone, Copy)]
struct Edge {
    difference: f32,
    ends: [u32; 2],
}

/// The segment of each of `count` Gaussians: the index of one of them.
fn cut(count: usize, mut edges: Vec<Edge>) -> Vec<usize> {
    edges.par_sort_unstable_by(|a, b| {
        a.difference.total_cmp(&b.difference).then(a.ends.cmp(&b.ends))
    });
    let mut sets = DisjointSets::new(count);
    let mut sizes = vec![1_usize; count];
    let mut limits = vec![TOLERANCE; count];
    for Edge { difference, ends } in edges {
        let [a, b] = ends.map(|end| sets.representative(end as usize));
        if a == b || difference > limits[a].min(limits[b]) {
            continue;
        }
        let size = sizes[a] + sizes[b];
        sets.join(a, b);
        let joined = sets.representative(a);
        sizes[joined] = size;
        limits[joined] = difference + TOLERANCE / size as f32;
    }
    (0..count).map(|at| sets.representative(at)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::query::answer::ScoredPoint;
    use nalgebra::Point3;

    /// Disks 2 cm apart, 40 by 20: colors and normals by their columns.
    fn surface(
        color: impl Fn(usize) -> [f32; 3],
        is_upright: impl Fn(usize) -> bool,
    ) -> (HostGaussians, Vec<RelevantGaussian>) {
        let mut gaussians = HostGaussians::default();
        let mut opaque = Vec::new();
        for (row, at) in (0_u32..800).zip(0_usize..) {
            let column = at % 40;
            let position = Point3::new(0.02 * column as f32, 0.02 * (at / 40) as f32, 0.0);
            let log_scales =
                if is_upright(column) { [-6.0, -4.5, -4.5] } else { [-4.5, -4.5, -6.0] };
            gaussians.means.push(position.into());
            gaussians.color.rotations.push([1.0, 0.0, 0.0, 0.0]);
            gaussians.color.log_scales.push(log_scales);
            gaussians.color.features.extend(color(column));
            let point = ScoredPoint { position, score: 0.0 };
            opaque.push(RelevantGaussian { row, point, opacity: 0.9, spread: 0.2, radius: 0.01 });
        }
        (gaussians, opaque)
    }

    /// The segments of the first and of the last column, and the number of all.
    fn ends((gaussians, opaque): &(HostGaussians, Vec<RelevantGaussian>)) -> (u32, u32, usize) {
        let Segments { segment_of, weights } = Segments::new(gaussians, opaque);
        (segment_of[0], segment_of[39], weights.iter().filter(|weight| **weight > 0.0).count())
    }

    const GREY: [f32; 3] = [0.5; 3];

    #[test]
    fn surfaces_are_cut_where_color_or_direction_changes() {
        let colored = surface(|column| if column < 20 { GREY } else { [0.9, 0.5, 0.2] }, |_| false);
        let bent = surface(|_| GREY, |column| column < 20);
        for surface in [colored, bent] {
            let (first, last, count) = ends(&surface);
            assert!(first != last && count == 2, "{count}");
        }
        // Negative controls: one color, and a color that changes slowly by as much.
        let slow = |column: usize| [0.5 + 0.01 * column as f32, 0.5, 0.5 - 0.0075 * column as f32];
        for surface in [surface(|_| GREY, |_| false), surface(slow, |_| false)] {
            let (first, last, count) = ends(&surface);
            assert!(first == last && count == 1, "{count}");
        }
    }

    #[test]
    fn the_share_of_a_segment_that_is_relevant_tells_a_patch_from_a_thing() {
        let (gaussians, opaque) =
            surface(|column| if column < 20 { GREY } else { [0.9, 0.5, 0.2] }, |_| false);
        let segments = Segments::new(&gaussians, &opaque);
        // Five columns of the first half, and all of the second.
        let is_relevant = |one: &&RelevantGaussian| one.row % 40 < 5 || one.row % 40 >= 20;
        let relevant: Vec<_> = opaque.iter().filter(is_relevant).copied().collect();
        for (one, share) in relevant.iter().zip(segments.relevant_shares(&relevant)) {
            let expected = if one.row % 40 < 5 { 0.25 } else { 1.0 };
            assert!((share - expected).abs() < 1e-4, "{}: {share}", one.row);
        }
        assert!(segments.relevant_shares(&[]).is_empty());
        let none = Segments::new(&HostGaussians::default(), &[]);
        assert!(none.relevant_shares(&[]).is_empty());
    }
}
