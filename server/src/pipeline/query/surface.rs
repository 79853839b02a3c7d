//! What relevant Gaussians cover, as points.
//!
//! In: Gaussians of a map and their relevancies. Out: points at even distances on their disks. Where
//! a surface is plain one Gaussian covers much of it, and its centre alone would say little of where the
//! thing is and where it ends.

use super::answer::ScoredPoint;
use super::clusters::Weighted;
use lexsplat_gpu::HostHead;
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use rayon::prelude::*;
use rustc_hash::FxHashMap as HashMap;

/// Between points, metres: as far as the voxels of the 3D protocol.
pub const SPACING_METRES: f32 = 0.02;
/// A disk ends at so many standard deviations: a newborn one then covers its square but for the corners.
const DEVIATIONS: f32 = 1.3;
/// Most points to each side of a disk's centre: what is larger is sampled more thinly.
const MOST_STEPS: i32 = 25;
/// Gaussians that are sampled at a time.
const BATCH: usize = 4096;

/// At most one point to a voxel of [`SPACING_METRES`], that of the most relevant Gaussian there, in the
/// order of the Gaussians. Every Gaussian's centre is in a voxel that has a point.
pub(super) fn sampled(head: &HostHead, covering: &[Weighted]) -> Vec<ScoredPoint> {
    let batches: Vec<Vec<(Voxel, ScoredPoint)>> = covering
        .par_chunks(BATCH)
        .map(|some| {
            let mut found = Vec::with_capacity(2 * some.len());
            some.iter().for_each(|one| disk(head, one, &mut found));
            found
        })
        .collect();
    let mut place_of: HashMap<Voxel, usize> = HashMap::default();
    let mut points: Vec<ScoredPoint> = Vec::with_capacity(covering.len());
    for (voxel, point) in batches.into_iter().flatten() {
        let place = *place_of.entry(voxel).or_insert(points.len());
        match points.get_mut(place) {
            None => points.push(point),
            Some(other) if other.score < point.score => *other = point,
            Some(_) => {}
        }
    }
    points
}

type Voxel = [i32; 3];

/// The centre, and a grid over the ellipse that the two longer axes span.
fn disk(head: &HostHead, one: &Weighted, found: &mut Vec<(Voxel, ScoredPoint)>) {
    let mut add = |position: Point3<f32>| {
        let voxel = std::array::from_fn(|axis| (position[axis] / SPACING_METRES).floor() as i32);
        found.push((voxel, ScoredPoint { position, ..one.point }));
    };
    add(one.point.position);
    let ([u, v], [long, wide]) = axes(head, one.row as usize);
    let (along, across) = (steps(long), steps(wide));
    for i in -along..=along {
        for j in -across..=across {
            let (a, b) = (i as f32 / (along + 1) as f32, j as f32 / (across + 1) as f32);
            if (i, j) != (0, 0) && a * a + b * b <= 1.0 {
                add(one.point.position + u * (a * long) + v * (b * wide));
            }
        }
    }
}

/// Points to each side of the centre, none if the disk ends before the next would come.
fn steps(radius: f32) -> i32 {
    ((radius / SPACING_METRES) as i32).min(MOST_STEPS)
}

/// Directions and radii of a Gaussian's two longer axes, longest first.
fn axes(head: &HostHead, row: usize) -> ([Vector3<f32>; 2], [f32; 2]) {
    let [w, x, y, z] = head.rotations[row];
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let scales = head.log_scales[row];
    let mut order = [0, 1, 2];
    order.sort_by(|&a: &usize, &b: &usize| scales[b].total_cmp(&scales[a]));
    let axis = |at: usize| rotation * Vector3::ith(at, 1.0);
    let radius = |at: usize| DEVIATIONS * scales[at].exp();
    ([axis(order[0]), axis(order[1])], [radius(order[0]), radius(order[1])])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(rows: &[([f32; 4], [f32; 3])]) -> HostHead {
        HostHead {
            rotations: rows.iter().map(|(rotation, _)| *rotation).collect(),
            log_scales: rows.iter().map(|(_, scales)| scales.map(f32::ln)).collect(),
            ..HostHead::default()
        }
    }

    fn covering(row: u32, position: Point3<f32>, score: f32) -> Weighted {
        Weighted { row, point: ScoredPoint { position, score }, opacity: 0.9, reach: 0.0 }
    }

    #[test]
    fn a_disk_is_covered_and_nothing_beside_it() {
        // Flat along its x axis, turned by 90 degrees about z: flat along the world's y.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let head = head(&[([half, 0.0, 0.0, half], [0.004, 0.1 / DEVIATIONS, 0.2 / DEVIATIONS])]);
        let middle = Point3::new(1.0, 2.0, 3.0);
        let points = sampled(&head, &[covering(0, middle, 0.7)]);
        let inside = |point: &ScoredPoint| {
            let off = point.position - middle;
            (off.x / 0.1).powi(2) + (off.z / 0.2).powi(2) <= 1.0 + 1e-3 && off.y.abs() < 1e-5
        };
        assert!(points.iter().all(|point| inside(point) && point.score == 0.7));
        let nearest = |x: f32, z: f32| {
            let there = middle + Vector3::new(x, 0.0, z);
            points.iter().map(|p| (p.position - there).norm()).fold(f32::INFINITY, f32::min)
        };
        // Everywhere on it a point is near; negative control: not so beside it.
        for (x, z) in [(0.0, 0.0), (0.09, 0.0), (-0.09, 0.0), (0.0, 0.19), (0.05, -0.15)] {
            assert!(nearest(x, z) < 1.1 * SPACING_METRES, "{x} {z}: {}", nearest(x, z));
        }
        assert!(nearest(0.1, 0.2) > 2.0 * SPACING_METRES);
        // About as many as its area has voxels (diagonals fall in neighbouring ones).
        let voxels = std::f32::consts::PI * 0.1 * 0.2 / SPACING_METRES.powi(2);
        let share = points.len() as f32 / voxels;
        assert!((0.7..1.3).contains(&share), "{} of {voxels}", points.len());
    }

    #[test]
    fn a_voxel_has_one_point_and_small_gaussians_their_centre() {
        let head = head(&[([1.0, 0.0, 0.0, 0.0], [0.003; 3]); 3]);
        let here = Point3::new(0.001, 0.001, 0.001);
        let near = Point3::new(0.004, 0.004, 0.004);
        let far = Point3::new(0.5, 0.5, 0.5);
        let all = [covering(0, here, 0.6), covering(1, near, 0.8), covering(2, far, 0.7)];
        let points = sampled(&head, &all);
        assert_eq!(points.len(), 2);
        assert_eq!((points[0].position, points[0].score), (near, 0.8), "the most relevant one");
        assert_eq!((points[1].position, points[1].score), (far, 0.7));
        assert!(sampled(&head, &[]).is_empty());
    }

    #[test]
    fn a_huge_gaussian_has_no_more_points_than_it_may() {
        let head = head(&[([1.0, 0.0, 0.0, 0.0], [50.0, 50.0, 0.1])]);
        let points = sampled(&head, &[covering(0, Point3::origin(), 0.5)]);
        let most = (2 * MOST_STEPS + 1).pow(2) as usize;
        assert!(points.len() > 1000 && points.len() <= most, "{}", points.len());
    }
}
