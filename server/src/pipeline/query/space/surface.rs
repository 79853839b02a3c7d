//! Points on the surface of relevant Gaussians.
//!
//! In: relevant Gaussians of a map. Out: points at even distances on their disks. On an even
//! surface one Gaussian covers a large area, of which its centre alone would not show the extent.

use super::gaussian::RelevantGaussian;
use crate::pipeline::query::answer::ScoredPoint;
use lexsplat_gpu::HostHead;
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use rayon::prelude::*;
use rustc_hash::FxHashMap as HashMap;

/// Distance of the points, metres: the side of a voxel in the paper's 3D protocol.
const SPACING_METRES: f32 = 0.02;
/// Radius of a disk, standard deviations: that of a new Gaussian covers its square of pixels,
/// except for the corners.
const DEVIATIONS: f32 = 1.3;
/// The most points from the centre of a disk to its border. Larger disks are sampled more sparsely.
const MAX_STEPS: i32 = 25;
/// Gaussians sampled by one core at a time.
const BATCH: usize = 4096;

/// Points on the disks of Gaussians, in their order: at most one for each voxel of
/// [`SPACING_METRES`], from the most relevant Gaussian in it. The voxel of each centre has a point.
pub(super) fn sample(head: &HostHead, gaussians: &[RelevantGaussian]) -> Vec<ScoredPoint> {
    let batches: Vec<Vec<(Voxel, ScoredPoint)>> = gaussians
        .par_chunks(BATCH)
        .map(|batch| {
            let mut found = Vec::with_capacity(2 * batch.len());
            batch.iter().for_each(|gaussian| sample_disk(head, gaussian, &mut found));
            found
        })
        .collect();
    let mut point_of_voxel: HashMap<Voxel, usize> = HashMap::default();
    let mut points: Vec<ScoredPoint> = Vec::with_capacity(gaussians.len());
    for (voxel, point) in batches.into_iter().flatten() {
        let at = *point_of_voxel.entry(voxel).or_insert(points.len());
        match points.get_mut(at) {
            None => points.push(point),
            Some(other) if other.score < point.score => *other = point,
            Some(_) => {}
        }
    }
    points
}

type Voxel = [i32; 3];

/// Adds the centre, and a grid over the ellipse of the two longer axes.
fn sample_disk(
    head: &HostHead,
    gaussian: &RelevantGaussian,
    found: &mut Vec<(Voxel, ScoredPoint)>,
) {
    let mut add = |position: Point3<f32>| {
        let voxel = std::array::from_fn(|axis| (position[axis] / SPACING_METRES).floor() as i32);
        found.push((voxel, ScoredPoint { position, ..gaussian.point }));
    };
    add(gaussian.point.position);
    let ([u, v], [long, wide]) = axes(head, gaussian.row as usize);
    let (along, across) = (steps(long), steps(wide));
    for i in -along..=along {
        for j in -across..=across {
            let (a, b) = (i as f32 / (along + 1) as f32, j as f32 / (across + 1) as f32);
            if (i, j) != (0, 0) && a * a + b * b <= 1.0 {
                add(gaussian.point.position + u * (a * long) + v * (b * wide));
            }
        }
    }
}

/// Points from the centre to the border of a disk, without the centre.
fn steps(radius: f32) -> i32 {
    ((radius / SPACING_METRES) as i32).min(MAX_STEPS)
}

/// Directions and radii of the two longer axes of a Gaussian, longest first.
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

    fn gaussian(row: u32, position: Point3<f32>, score: f32) -> RelevantGaussian {
        RelevantGaussian {
            row,
            point: ScoredPoint { position, score },
            opacity: 0.9,
            spread: 0.2,
            radius: 0.0,
        }
    }

    #[test]
    fn points_cover_the_disk_and_nothing_else() {
        // Flat along its x axis, turned by 90 degrees about z: flat along the world's y.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let head = head(&[([half, 0.0, 0.0, half], [0.004, 0.1 / DEVIATIONS, 0.2 / DEVIATIONS])]);
        let middle = Point3::new(1.0, 2.0, 3.0);
        let points = sample(&head, &[gaussian(0, middle, 0.7)]);
        let inside = |point: &ScoredPoint| {
            let off = point.position - middle;
            (off.x / 0.1).powi(2) + (off.z / 0.2).powi(2) <= 1.0 + 1e-3 && off.y.abs() < 1e-5
        };
        assert!(points.iter().all(|point| inside(point) && point.score == 0.7));
        let nearest = |x: f32, z: f32| {
            let there = middle + Vector3::new(x, 0.0, z);
            points.iter().map(|p| (p.position - there).norm()).fold(f32::INFINITY, f32::min)
        };
        // Each place on the disk has a point nearby. Negative control: a place beside it has none.
        for (x, z) in [(0.0, 0.0), (0.09, 0.0), (-0.09, 0.0), (0.0, 0.19), (0.05, -0.15)] {
            assert!(nearest(x, z) < 1.1 * SPACING_METRES, "{x} {z}: {}", nearest(x, z));
        }
        assert!(nearest(0.1, 0.2) > 2.0 * SPACING_METRES);
        // About one point for each voxel of its area.
        let voxels = std::f32::consts::PI * 0.1 * 0.2 / SPACING_METRES.powi(2);
        let share = points.len() as f32 / voxels;
        assert!((0.7..1.3).contains(&share), "{} of {voxels}", points.len());
    }

    #[test]
    fn a_voxel_has_one_point_and_small_gaussians_have_their_centre() {
        let head = head(&[([1.0, 0.0, 0.0, 0.0], [0.003; 3]); 3]);
        let here = Point3::new(0.001, 0.001, 0.001);
        let near = Point3::new(0.004, 0.004, 0.004);
        let far = Point3::new(0.5, 0.5, 0.5);
        let all = [gaussian(0, here, 0.6), gaussian(1, near, 0.8), gaussian(2, far, 0.7)];
        let points = sample(&head, &all);
        assert_eq!(points.len(), 2);
        assert_eq!((points[0].position, points[0].score), (near, 0.8), "the most relevant one");
        assert_eq!((points[1].position, points[1].score), (far, 0.7));
        assert!(sample(&head, &[]).is_empty());
    }

    #[test]
    fn a_huge_gaussian_has_a_limited_number_of_points() {
        let head = head(&[([1.0, 0.0, 0.0, 0.0], [50.0, 50.0, 0.1])]);
        let points = sample(&head, &[gaussian(0, Point3::origin(), 0.5)]);
        let most = (2 * MAX_STEPS + 1).pow(2) as usize;
        assert!(points.len() > 1000 && points.len() <= most, "{}", points.len());
    }
}
