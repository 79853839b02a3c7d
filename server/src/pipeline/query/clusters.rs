//! Relevant Gaussians to objects: dense places that hang together.
//!
//! DBSCAN (Ester et al. 1996) on a grid of voxels: a voxel is dense if it and its 26 neighbours
//! hold enough points; dense voxels that touch are one cluster; others join a dense neighbour, or
//! are floaters and belong to nothing.

use super::answer::{Object, ScoredPoint};
use super::boxes;
use std::collections::HashMap;

/// A relevant Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighted {
    /// Centre and relevancy.
    pub point: ScoredPoint,
    /// Opacity of its language, 0..1.
    pub opacity: f32,
}

/// How near is together, and how many are an object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// Side of a voxel, metres.
    pub metres: f32,
    /// Points in a voxel and its neighbours.
    pub points: usize,
}

/// Clusters as objects, best first.
pub(super) fn objects(relevant: &[Weighted], density: Density) -> Vec<Object> {
    let mut found: Vec<Object> = clusters(relevant, density)
        .into_iter()
        .map(|members| object(&members.iter().map(|&at| relevant[at]).collect::<Vec<_>>()))
        .collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score).then(b.points.cmp(&a.points)));
    found
}

fn object(members: &[Weighted]) -> Object {
    let positions: Vec<_> = members.iter().map(|member| member.point.position).collect();
    let fitted = boxes::fit(&positions);
    Object {
        score: score(members),
        center: fitted.center,
        size: fitted.size,
        rotation: fitted.world_from_box,
        aabb_min: fitted.aabb_min,
        aabb_max: fitted.aabb_max,
        points: members.len(),
        distance: None,
    }
}

/// Mean relevancy of the best quarter, weighted by opacity: an object's edge does not speak for it.
fn score(members: &[Weighted]) -> f32 {
    let mut sorted = members.to_vec();
    sorted.sort_by(|a, b| b.point.score.total_cmp(&a.point.score));
    let best = &sorted[..members.len().div_ceil(4)];
    let weight: f32 = best.iter().map(|member| member.opacity).sum();
    best.iter().map(|member| member.point.score * member.opacity).sum::<f32>() / weight.max(1e-6)
}

struct Voxel {
    at: [i32; 3],
    members: Vec<usize>,
}

/// Indices of the members of every cluster.
fn clusters(relevant: &[Weighted], density: Density) -> Vec<Vec<usize>> {
    let (voxels, by_place) = voxels(relevant, density.metres);
    let neighbours = |at: [i32; 3]| around(at).filter_map(|place| by_place.get(&place).copied());
    let crowd =
        |voxel: &Voxel| neighbours(voxel.at).map(|n| voxels[n].members.len()).sum::<usize>();
    let dense: Vec<bool> = voxels.iter().map(|voxel| crowd(voxel) >= density.points).collect();

    let mut cluster_of: Vec<Option<usize>> = vec![None; voxels.len()];
    let mut count = 0;
    for start in 0..voxels.len() {
        if !dense[start] || cluster_of[start].is_some() {
            continue;
        }
        cluster_of[start] = Some(count);
        let mut stack = vec![start];
        while let Some(voxel) = stack.pop() {
            for neighbour in neighbours(voxels[voxel].at) {
                if dense[neighbour] && cluster_of[neighbour].is_none() {
                    cluster_of[neighbour] = Some(count);
                    stack.push(neighbour);
                }
            }
        }
        count += 1;
    }

    let mut found = vec![Vec::new(); count];
    for (index, voxel) in voxels.iter().enumerate() {
        // A voxel that is not dense joins its fullest dense neighbour.
        let host = || {
            neighbours(voxel.at)
                .filter(|&neighbour| dense[neighbour])
                .max_by_key(|&neighbour| (voxels[neighbour].members.len(), neighbour))
        };
        let cluster = cluster_of[index].or_else(|| host().and_then(|host| cluster_of[host]));
        if let Some(cluster) = cluster {
            found[cluster].extend(&voxel.members);
        }
    }
    found
}

/// Occupied voxels in the order of their first points, and where each is.
fn voxels(relevant: &[Weighted], metres: f32) -> (Vec<Voxel>, HashMap<[i32; 3], usize>) {
    let mut voxels: Vec<Voxel> = Vec::new();
    let mut by_place = HashMap::new();
    for (index, weighted) in relevant.iter().enumerate() {
        let position = weighted.point.position;
        let at = std::array::from_fn(|axis| (position[axis] / metres).floor() as i32);
        let voxel = *by_place.entry(at).or_insert_with(|| {
            voxels.push(Voxel { at, members: Vec::new() });
            voxels.len() - 1
        });
        voxels[voxel].members.push(index);
    }
    (voxels, by_place)
}

/// A voxel's place and the 26 around it.
fn around(at: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..27).map(move |i| {
        let step = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
        std::array::from_fn(|axis| at[axis].saturating_add(step[axis]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const DENSITY: Density = Density { metres: 0.08, points: 8 };

    fn weighted(position: Point3<f32>, score: f32) -> Weighted {
        Weighted { point: ScoredPoint { position, score }, opacity: 0.9 }
    }

    fn blob(center: Point3<f32>, score: f32, random: &mut ChaCha8Rng) -> Vec<Weighted> {
        let mut offset = || random.random_range(-0.15_f32..0.15);
        (0..300)
            .map(|_| weighted(center + nalgebra::vector![offset(), offset(), offset()], score))
            .collect()
    }

    #[test]
    fn two_blobs_and_floaters_are_two_objects() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut points = blob(Point3::new(0.0, 0.0, 0.0), 0.7, &mut random);
        points.extend(blob(Point3::new(1.0, 0.0, 0.2), 0.9, &mut random));
        for i in 0..20 {
            points.push(weighted(Point3::new(-1.0 - 0.5 * i as f32, 2.0, 0.0), 0.99));
        }
        let found = objects(&points, DENSITY);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!((found[0].center - Point3::new(1.0, 0.0, 0.2)).norm() < 0.03, "{:?}", found[0]);
        assert!((found[1].center - Point3::origin()).norm() < 0.03, "{:?}", found[1]);
        assert!((found[0].score - 0.9).abs() < 1e-5 && (found[1].score - 0.7).abs() < 1e-5);
        assert_eq!((found[0].points, found[1].points), (300, 300));

        // Negative control: voxels as large as the gap make one of them.
        assert_eq!(objects(&points, Density { metres: 0.5, points: 8 }).len(), 1);
        // And nothing is dense enough for a thousand.
        assert!(objects(&points, Density { metres: 0.08, points: 1000 }).is_empty());
    }

    #[test]
    fn an_object_s_score_is_that_of_its_best_quarter() {
        let at = |i: usize| Point3::new(0.001 * i as f32, 0.0, 0.0);
        let points: Vec<_> =
            (0..40).map(|i| weighted(at(i), if i < 10 { 0.9 } else { 0.5 })).collect();
        let found = objects(&points, DENSITY);
        assert_eq!(found.len(), 1);
        assert!((found[0].score - 0.9).abs() < 1e-6, "{}", found[0].score);
    }
}
