//! Distances between point clouds, metres: Chamfer and earth mover's distance; voxel means;
//! samples.
//!
//! Chamfer = mean over a of |a - nearest b| + mean over b of |b - nearest a|, not squared (paper
//! §5, "3D localisation"). EMD = the mean distance of the best one-to-one pairing of two samples of
//! equal size: exact, by shortest augmenting paths (D. Crouse, "On implementing 2D rectangular
//! assignment algorithms", 2016, as in SciPy's `linear_sum_assignment`). Its only error is that of
//! the sampling.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use rstar::RTree;
use std::collections::HashMap;

/// A point, metres.
pub type Point = [f64; 3];

/// Seed of the sampling: every run samples the same points.
const SEED: u64 = 0x5eed;

/// Points gathered in voxels, so that places seen often do not weigh more.
#[derive(Debug)]
pub struct Voxels {
    side: f64,
    /// Sum and number of the points of each voxel.
    cells: HashMap<[i64; 3], (Point, f64)>,
}

impl Voxels {
    /// Empty voxels of this side, metres.
    pub fn new(side: f64) -> Self {
        Self { side, cells: HashMap::new() }
    }

    /// Adds a point.
    pub fn add(&mut self, point: Point) {
        let at = point.map(|value| (value / self.side).floor() as i64);
        let (sum, count) = self.cells.entry(at).or_default();
        sum.iter_mut().zip(point).for_each(|(sum, value)| *sum += value);
        *count += 1.0;
    }

    /// The mean of each voxel's points, ordered by voxel.
    pub fn means(&self) -> Vec<Point> {
        let mut cells: Vec<_> = self.cells.iter().collect();
        cells.sort_unstable_by_key(|(at, _)| **at);
        cells.into_iter().map(|(_, (sum, count))| sum.map(|value| value / count)).collect()
    }
}

/// The two terms of the Chamfer distance: from `found` to `truth` and back. `None` if one is empty.
pub fn chamfer(found: &[Point], truth: &[Point]) -> Option<[f64; 2]> {
    if found.is_empty() || truth.is_empty() {
        return None;
    }
    let mean_to = |from: &[Point], to: &[Point]| {
        let tree = RTree::bulk_load(to.to_vec());
        let distance = |point: &Point| {
            let nearest = tree.nearest_neighbor(*point).expect("there is a point");
            distance(point, nearest)
        };
        // A sum in a fixed order: every run gives the same digits.
        from.par_iter().map(distance).collect::<Vec<_>>().into_iter().sum::<f64>()
            / from.len() as f64
    };
    Some([mean_to(found, truth), mean_to(truth, found)])
}

/// `count` random points, the same in every run. If there are fewer points, they are repeated, all
/// equally often or once more.
pub fn resampled(points: &[Point], count: usize) -> Vec<Point> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(SEED));
    order.into_iter().cycle().take(count).map(|at| points[at]).collect()
}

/// Mean distance of the best one-to-one pairing; `None` if the clouds are empty.
///
/// # Panics
/// If the clouds differ in size.
pub fn earth_movers(found: &[Point], truth: &[Point]) -> Option<f64> {
    assert_eq!(found.len(), truth.len(), "clouds of one size");
    let count = found.len();
    let costs: Vec<f64> =
        found.par_iter().flat_map_iter(|a| truth.iter().map(|b| distance(a, b))).collect();
    let pair_of = assigned(&costs, count);
    let sum: f64 =
        pair_of.iter().enumerate().map(|(row, column)| costs[row * count + column]).sum();
    (count > 0).then(|| sum / count as f64)
}

/// The column of each row in the cheapest one-to-one assignment; `costs` are `[count, count]`.
fn assigned(costs: &[f64], count: usize) -> Vec<usize> {
    const NONE: usize = usize::MAX;
    let (mut row_price, mut column_price) = (vec![0.0; count], vec![0.0; count]);
    let (mut column_of, mut row_of) = (vec![NONE; count], vec![NONE; count]);
    for start in 0..count {
        let mut cheapest = vec![f64::INFINITY; count];
        let mut came_from = vec![NONE; count];
        let (mut rows_done, mut open) = (vec![], (0..count).collect::<Vec<_>>());
        let (mut row, mut paid) = (start, 0.0);
        let sink = loop {
            rows_done.push(row);
            let line = &costs[row * count..][..count];
            let (mut least, mut at) = (f64::INFINITY, 0);
            for (place, &column) in open.iter().enumerate() {
                let way = paid + line[column] - row_price[row] - column_price[column];
                if way < cheapest[column] {
                    (cheapest[column], came_from[column]) = (way, row);
                }
                // Among equal ways, one to a free column ends the search.
                let is_better =
                    cheapest[column] < least || cheapest[column] == least && row_of[column] == NONE;
                if is_better {
                    (least, at) = (cheapest[column], place);
                }
            }
            paid = least;
            let column = open.swap_remove(at);
            if row_of[column] == NONE {
                break column;
            }
            row = row_of[column];
        };
        row_price[start] += paid;
        for &row in &rows_done[1..] {
            row_price[row] += paid - cheapest[column_of[row]];
        }
        let is_open: std::collections::HashSet<usize> = open.into_iter().collect();
        for column in (0..count).filter(|column| !is_open.contains(column)) {
            column_price[column] -= paid - cheapest[column];
        }
        let mut column = sink;
        loop {
            let row = came_from[column];
            row_of[column] = row;
            std::mem::swap(&mut column, &mut column_of[row]);
            if row == start {
                break;
            }
        }
    }
    column_of
}

fn distance(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clouds() -> (Vec<Point>, Vec<Point>) {
        let a = |i: i32| {
            let i = f64::from(i);
            [(7.0 * i).sin(), (5.0 * i).cos(), (3.0 * i + 1.0).sin()]
        };
        let b = |j: i32| {
            let j = f64::from(j);
            [(2.0 * j).cos() + 0.3, (11.0 * j).sin(), (4.0 * j).cos() * 0.5]
        };
        ((0..60).map(a).collect(), (0..45).map(b).collect())
    }

    #[test]
    fn distances_are_those_of_scipy() {
        // cKDTree(b).query(a)[0].mean(), cKDTree(a).query(b)[0].mean() and
        // linear_sum_assignment(cdist(a[:45], b)) of SciPy 1.17.1 on these formulas.
        let (a, b) = clouds();
        let [there, back] = chamfer(&a, &b).unwrap();
        assert!((there - 0.555_072_630_165_285_6).abs() < 1e-12, "{there}");
        assert!((back - 0.381_828_274_235_375_96).abs() < 1e-12, "{back}");
        let found = earth_movers(&a[..45], &b).unwrap();
        assert!((found - 0.661_585_667_904_672_1).abs() < 1e-12, "{found}");
        // Negative control: pairs in the order they come are farther apart.
        let unpaired: f64 = a.iter().zip(&b).map(|(a, b)| distance(a, b)).sum::<f64>() / 45.0;
        assert!(unpaired > found + 0.3, "{unpaired}");
    }

    #[test]
    fn the_distance_of_a_moved_cloud_is_its_motion() {
        // A lattice of 1 m, moved by less than half its spacing.
        let lattice: Vec<Point> =
            (0..64).map(|i| [i % 4, i / 4 % 4, i / 16].map(f64::from)).collect();
        let mut moved: Vec<Point> =
            lattice.iter().map(|[x, y, z]| [x + 0.3, *y, z - 0.4]).collect();
        moved.reverse();
        let [there, back] = chamfer(&moved, &lattice).unwrap();
        assert!((there - 0.5).abs() < 1e-12 && (back - 0.5).abs() < 1e-12);
        assert!((earth_movers(&moved, &lattice).unwrap() - 0.5).abs() < 1e-12);
        assert_eq!(earth_movers(&lattice, &lattice), Some(0.0));
        // A part of the truth is near it, and the truth is not near the part.
        let [there, back] = chamfer(&lattice[..16], &lattice).unwrap();
        assert!(there == 0.0 && back > 1.0, "{back}");
    }

    #[test]
    fn empty_clouds_have_no_distance() {
        assert_eq!(chamfer(&[], &[[0.0; 3]]), None);
        assert_eq!(chamfer(&[[0.0; 3]], &[]), None);
        assert_eq!(earth_movers(&[], &[]), None);
    }

    #[test]
    fn a_voxel_is_the_mean_of_its_points() {
        let mut voxels = Voxels::new(0.02);
        for x in [0.001, 0.003, 0.021, -0.001] {
            voxels.add([x, 0.0, 0.0]);
        }
        let found: Vec<f64> = voxels.means().into_iter().map(|[x, ..]| x).collect();
        assert_eq!(found.len(), 3);
        assert!((found[0] + 0.001).abs() < 1e-12 && (found[1] - 0.002).abs() < 1e-12);
    }

    #[test]
    fn samples_repeat_points_only_if_there_are_too_few() {
        let points: Vec<Point> = (0..100).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let mut some: Vec<i64> = resampled(&points, 40).into_iter().map(|p| p[0] as i64).collect();
        some.sort_unstable();
        some.dedup();
        assert_eq!(some.len(), 40);
        assert_ne!(some, (0..40).collect::<Vec<_>>(), "by chance");
        let all = resampled(&points[..3], 7);
        let twos = (0..3).filter(|i| all.iter().filter(|p| p[0] as i64 == *i).count() == 2).count();
        assert_eq!((all.len(), twos), (7, 2));
        assert!(resampled(&[], 4).is_empty());
    }
}
