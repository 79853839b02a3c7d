//! Relevant Gaussians to objects: those that hang together.
//!
//! DBSCAN (Ester et al. 1996) with a distance that follows the Gaussians' own size: two are neighbours
//! if less than `metres` lies between the balls of their reach. What was seen from afar has few and
//! large Gaussians, what was seen from near many small ones: both are one thing. A Gaussian with
//! [`NEIGHBOURS`] is at the core of something; cores that are neighbours are one cluster; others join
//! their nearest core, or are floaters and belong to nothing. A cluster of too few is noise.

use super::answer::{Object, ScoredPoint};
use super::boxes;
use rayon::prelude::*;
use std::collections::HashMap;

/// A relevant Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighted {
    /// Centre and relevancy.
    pub point: ScoredPoint,
    /// Opacity of its language, 0..1.
    pub opacity: f32,
    /// How far its ball reaches, metres, at least 0.
    pub reach: f32,
}

/// How near is together, and how many are an object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// Between the balls of neighbours, metres.
    pub metres: f32,
    /// Members of the smallest cluster.
    pub points: usize,
}

/// Neighbours of a core, itself among them.
const NEIGHBOURS: usize = 3;
/// Reaches up to this are of level 0, metres; each level holds twice as far ones.
const LEAST_REACH: f32 = 0.02;

/// What hangs together.
pub(super) struct Clusters {
    /// Best first.
    pub objects: Vec<Object>,
    /// The points that belong to an object, in order: without floaters.
    pub points: Vec<ScoredPoint>,
}

/// Clusters as objects, and their points.
pub(super) fn clustered(relevant: &[Weighted], density: Density) -> Clusters {
    let clusters = clusters(relevant, density);
    let mut members: Vec<usize> = clusters.iter().flatten().copied().collect();
    members.sort_unstable();
    let points = members.into_iter().map(|at| relevant[at].point).collect();
    Clusters { objects: objects(relevant, clusters), points }
}

fn objects(relevant: &[Weighted], clusters: Vec<Vec<usize>>) -> Vec<Object> {
    let mut found: Vec<Object> = clusters
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

/// Indices of the members of every cluster, in the order of their first members.
fn clusters(relevant: &[Weighted], density: Density) -> Vec<Vec<usize>> {
    let near = Neighbours::new(relevant, density.metres);
    let all: Vec<usize> = (0..relevant.len()).collect();
    let is_core: Vec<bool> =
        all.par_iter().map(|&at| near.of(at).take(NEIGHBOURS).count() == NEIGHBOURS).collect();
    let mut groups = Groups::new(relevant.len());
    for at in (0..relevant.len()).filter(|&at| is_core[at]) {
        near.of(at).filter(|&other| other < at && is_core[other]).for_each(|other| {
            groups.join(at, other);
        });
    }
    let host = |at: usize| {
        if is_core[at] {
            return Some(at);
        }
        let apart = |other: &usize| near.gap(at, *other);
        near.of(at).filter(|&other| is_core[other]).min_by(|a, b| apart(a).total_cmp(&apart(b)))
    };
    let hosts: Vec<Option<usize>> = all.par_iter().map(|&at| host(at)).collect();
    let mut place_of: HashMap<usize, usize> = HashMap::new();
    let mut found: Vec<Vec<usize>> = Vec::new();
    for (at, host) in hosts.into_iter().enumerate() {
        let Some(host) = host else { continue };
        let place = *place_of.entry(groups.of(host)).or_insert_with(|| {
            found.push(Vec::new());
            found.len() - 1
        });
        found[place].push(at);
    }
    found.retain(|members| members.len() >= density.points);
    found
}

type Cell = [i32; 3];

/// Who is near whom: a grid for each level of reach, with cells as large as its neighbours can be apart,
/// so that the many small ones need not be looked for as far as the few large ones.
struct Neighbours<'a> {
    relevant: &'a [Weighted],
    metres: f32,
    /// By level: the furthest reach in it, side of a cell, who is in each cell.
    levels: Vec<(f32, f32, HashMap<Cell, Vec<usize>>)>,
}

impl<'a> Neighbours<'a> {
    fn new(relevant: &'a [Weighted], metres: f32) -> Self {
        let mut levels: Vec<(f32, f32, HashMap<Cell, Vec<usize>>)> = Vec::new();
        for (at, weighted) in relevant.iter().enumerate() {
            let level = (weighted.reach / LEAST_REACH).max(1.0).log2().ceil() as usize;
            while levels.len() <= level {
                let most = LEAST_REACH * (1 << levels.len()) as f32;
                levels.push((most, metres + 2.0 * most, HashMap::new()));
            }
            let (_, side, cells) = &mut levels[level];
            let cell = cell_of(weighted, *side);
            cells.entry(cell).or_default().push(at);
        }
        levels.retain(|(_, _, cells)| !cells.is_empty());
        Self { relevant, metres, levels }
    }

    /// What lies between the balls of two, metres; negative where they overlap.
    fn gap(&self, a: usize, b: usize) -> f32 {
        let (a, b) = (&self.relevant[a], &self.relevant[b]);
        (a.point.position - b.point.position).norm() - a.reach - b.reach
    }

    /// The neighbours of one, itself among them.
    fn of(&self, at: usize) -> impl Iterator<Item = usize> {
        let one = &self.relevant[at];
        self.levels
            .iter()
            .flat_map(move |(most, side, cells)| {
                let far = self.metres + one.reach + most;
                let (center, steps) = (cell_of(one, *side), (far / side).ceil() as i32);
                around(center, steps).filter_map(|cell| cells.get(&cell)).flatten().copied()
            })
            .filter(move |&other| other == at || self.gap(at, other) < self.metres)
    }
}

fn cell_of(weighted: &Weighted, side: f32) -> Cell {
    std::array::from_fn(|axis| (weighted.point.position[axis] / side).floor() as i32)
}

/// A cell and those up to so many steps from it.
fn around(center: Cell, steps: i32) -> impl Iterator<Item = Cell> {
    let width = 2 * steps + 1;
    (0..width * width * width).map(move |i| {
        let step = [i % width, i / width % width, i / width / width];
        std::array::from_fn(|axis| center[axis].saturating_add(step[axis] - steps))
    })
}

/// Disjoint sets.
struct Groups(Vec<usize>);

impl Groups {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The one that stands for its set.
    fn of(&mut self, mut at: usize) -> usize {
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn objects(relevant: &[Weighted], density: Density) -> Vec<Object> {
        clustered(relevant, density).objects
    }

    const DENSITY: Density = Density { metres: 0.08, points: 8 };

    fn weighted(position: Point3<f32>, score: f32) -> Weighted {
        Weighted { point: ScoredPoint { position, score }, opacity: 0.9, reach: 0.01 }
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
        // Floaters are among the points of no answer, and nothing else is missing.
        let kept = clustered(&points, DENSITY).points;
        assert_eq!(kept.len(), 600);
        assert!(kept.iter().all(|point| point.score < 0.95), "the floaters' is 0.99");

        // Negative control: neighbours as far as the gap make one of them.
        let merged = objects(&points, Density { metres: 0.8, points: 8 });
        assert!(merged.iter().any(|object| object.points == 600), "{merged:?}");
        // And nothing is large enough for a thousand.
        assert!(objects(&points, Density { metres: 0.08, points: 1000 }).is_empty());
    }

    #[test]
    fn far_things_of_few_large_gaussians_are_objects() {
        // A chair from afar: 18 cm apart, as large as that.
        let far: Vec<_> = (0..12)
            .map(|i| weighted(Point3::new(0.18 * (i % 4) as f32, 0.18 * (i / 4) as f32, 5.0), 0.9))
            .collect();
        assert!(objects(&far, DENSITY).is_empty(), "small and apart they are floaters");
        let large: Vec<_> = far.iter().map(|one| Weighted { reach: 0.15, ..*one }).collect();
        let found = objects(&large, DENSITY);
        assert_eq!((found.len(), found[0].points), (1, 12));
        // A near thing is not drawn into it by their size: half a metre between them.
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut both = large;
        both.extend(blob(Point3::new(0.3, 1.2, 5.0), 0.8, &mut random));
        assert_eq!(objects(&both, DENSITY).len(), 2);
    }

    #[test]
    fn neighbours_are_those_of_a_search_of_all() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let points: Vec<_> = (0..400)
            .map(|_| {
                let mut at = || random.random_range(-1.0_f32..1.0);
                let position = Point3::new(at(), at(), at());
                let reach = random.random_range(0.0_f32..0.2);
                Weighted { reach: reach * reach * 5.0, ..weighted(position, 0.5) }
            })
            .collect();
        let near = Neighbours::new(&points, 0.08);
        let mut pairs = 0;
        for at in 0..points.len() {
            let mut found: Vec<usize> = near.of(at).collect();
            found.sort_unstable();
            let expected: Vec<usize> = (0..points.len())
                .filter(|&other| other == at || near.gap(at, other) < 0.08)
                .collect();
            assert_eq!(found, expected, "{at}");
            pairs += found.len() - 1;
        }
        assert!(pairs > 400, "{pairs}");
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
