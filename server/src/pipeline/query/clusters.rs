//! Relevant Gaussians to objects: those that hang together.
//!
//! DBSCAN (Ester et al. 1996) with a distance that follows the Gaussians' own size: two are neighbours
//! if less than `metres` lies between the balls of their reach. What was seen from afar has few and
//! large Gaussians, what was seen from near many small ones: both are one thing. A Gaussian with
//! three neighbours, itself among them, is at the core of something; cores that are neighbours are one
//! cluster; others join their nearest core, or are floaters and belong to nothing. A cluster of too few
//! is noise.
//!
//! It is done twice. How sure the best of the first clusters is says from which relevancy on a Gaussian
//! holds something together; of the second ones only these are cores. Things that stand beside each other
//! on what is a little like them (chairs on a carpet) would be one thing otherwise.

use super::answer::{Object, ScoredPoint};
use super::boxes;
use super::neighbours::Neighbours;
use rayon::prelude::*;
use rustc_hash::FxHashMap as HashMap;

/// A relevant Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighted {
    /// Its index in the map.
    pub row: u32,
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

/// Which clusters are worth telling beside the best: a map is never quite sure, and crumbs of things
/// that look alike lie about.
#[derive(Clone, Copy, Debug)]
pub(super) struct Worth {
    /// Relevancy that all points are above.
    pub threshold: f32,
    /// How far above it a score must be, as a share of how far the best one is: both as logits, which grow
    /// as cosines do, where relevancies crowd below 1.
    pub score: f32,
    /// Least members, as a share of the largest cluster's.
    pub size: f32,
}

/// Relevancy of a core, as a share of the score that is worth telling: less would hold the carpet and the
/// chairs together, more would take a chair's seat and back apart.
const CORE: f32 = 0.5;

impl Worth {
    /// The relevancy that is so far above the threshold as this share of the best cluster's score, as
    /// logits.
    fn above(self, share: f32, best: f32) -> f32 {
        let threshold = logit(self.threshold);
        1.0 / (1.0 + (-threshold - share * (logit(best) - threshold)).exp())
    }

    /// What is left of clusters, best first, and their members.
    fn sifted(self, mut found: Vec<(Object, Vec<usize>)>) -> Vec<(Object, Vec<usize>)> {
        let least = self.above(self.score, best(&found));
        let largest = found.iter().map(|(object, _)| object.points).max().unwrap_or(0);
        found.retain(|(object, _)| {
            object.score >= least && object.points as f32 >= self.size * largest as f32
        });
        found
    }
}

/// Score of the best cluster.
fn best(found: &[(Object, Vec<usize>)]) -> f32 {
    found.first().map_or(0.0, |(object, _)| object.score)
}

fn logit(share: f32) -> f32 {
    let share = share.clamp(1e-6, 1.0 - 1e-6);
    (share / (1.0 - share)).ln()
}

/// What hangs together.
pub(super) struct Clusters {
    /// Best first.
    pub objects: Vec<Object>,
    /// Indices of those that belong to an object, in order: without floaters.
    pub members: Vec<usize>,
}

/// Clusters as objects, and their members.
pub(super) fn clustered(relevant: &[Weighted], density: Density, worth: Worth) -> Clusters {
    let near = Neighbours::new(relevant, density.metres);
    let mut is_core = near.cores();
    let at_first = objects(relevant, clusters(&near, &is_core, density.points));
    let least = worth.above(CORE * worth.score, best(&at_first));
    for (is_core, one) in is_core.iter_mut().zip(relevant) {
        *is_core &= one.point.score >= least;
    }
    let found = worth.sifted(objects(relevant, clusters(&near, &is_core, density.points)));
    let mut members: Vec<usize> = found.iter().flat_map(|(_, members)| members).copied().collect();
    members.sort_unstable();
    Clusters { objects: found.into_iter().map(|(object, _)| object).collect(), members }
}

/// Best first.
fn objects(relevant: &[Weighted], clusters: Vec<Vec<usize>>) -> Vec<(Object, Vec<usize>)> {
    let weighted = |members: &[usize]| members.iter().map(|&at| relevant[at]).collect::<Vec<_>>();
    let mut found: Vec<(Object, Vec<usize>)> =
        clusters.into_iter().map(|members| (object(&weighted(&members)), members)).collect();
    found.sort_by(|(a, _), (b, _)| b.score.total_cmp(&a.score).then(b.points.cmp(&a.points)));
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

/// Indices of the members of every cluster of at least so many, in the order of their first members.
fn clusters(near: &Neighbours, is_core: &[bool], least: usize) -> Vec<Vec<usize>> {
    let mut groups = near.joined(is_core);
    let host = |at: usize| {
        if is_core[at] {
            return Some(at);
        }
        let apart = |other: &usize| near.gap(at, *other);
        near.of(at).filter(|&other| is_core[other]).min_by(|a, b| apart(a).total_cmp(&apart(b)))
    };
    let hosts: Vec<Option<usize>> = (0..is_core.len()).into_par_iter().map(host).collect();
    let mut place_of: HashMap<usize, usize> = HashMap::default();
    let mut found: Vec<Vec<usize>> = Vec::new();
    for (at, host) in hosts.into_iter().enumerate() {
        let Some(host) = host else { continue };
        let place = *place_of.entry(groups.of(host)).or_insert_with(|| {
            found.push(Vec::new());
            found.len() - 1
        });
        found[place].push(at);
    }
    found.retain(|members| members.len() >= least);
    found
}

#[cfg(test)]
mod tests {
    use super::super::neighbours::NEIGHBOURS;
    use super::*;
    use nalgebra::Point3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const ALL: Worth = Worth { threshold: 0.5, score: 0.0, size: 0.0 };

    fn objects(relevant: &[Weighted], density: Density) -> Vec<Object> {
        clustered(relevant, density, ALL).objects
    }

    #[test]
    fn crumbs_are_not_told_beside_a_thing() {
        let mut random = ChaCha8Rng::seed_from_u64(9);
        let mut points = blob(Point3::origin(), 0.9, &mut random);
        // As good and as large; as good and tiny; as large and doubtful.
        points.extend(blob(Point3::new(1.0, 0.0, 0.0), 0.8, &mut random));
        points.extend(
            blob(Point3::new(2.0, 0.0, 0.0), 0.9, &mut random)
                .drain(..)
                .take(20)
                .map(|one| Weighted { reach: 0.2, ..one }),
        );
        points.extend(blob(Point3::new(3.0, 0.0, 0.0), 0.6, &mut random));
        assert_eq!(objects(&points, DENSITY).len(), 4);
        let worth = Worth { threshold: 0.5, score: 0.5, size: 0.1 };
        let told = clustered(&points, DENSITY, worth);
        assert_eq!((told.objects.len(), told.members.len()), (2, 600));
        // What is alone is told however doubtful it is.
        let alone = blob(Point3::origin(), 0.55, &mut random);
        assert_eq!(clustered(&alone, DENSITY, worth).objects.len(), 1);
        assert!(clustered(&[], DENSITY, worth).objects.is_empty());
    }

    #[test]
    fn things_on_what_is_a_little_like_them_are_apart() {
        let mut random = ChaCha8Rng::seed_from_u64(10);
        let mut points = blob(Point3::origin(), 0.9, &mut random);
        points.extend(blob(Point3::new(1.0, 0.0, 0.0), 0.9, &mut random));
        points.extend((0..100).map(|i| weighted(Point3::new(0.01 * i as f32, 0.0, 0.0), 0.6)));
        let worth = Worth { threshold: 0.5, score: 0.5, size: 0.0 };
        let told = clustered(&points, DENSITY, worth);
        assert_eq!(told.objects.len(), 2);
        assert!((600..680).contains(&told.members.len()), "{}", told.members.len());
        // Negative control: if all that is above the threshold is as good, they are one.
        assert_eq!(objects(&points, DENSITY).len(), 1);
    }

    const DENSITY: Density = Density { metres: 0.08, points: 8 };

    fn weighted(position: Point3<f32>, score: f32) -> Weighted {
        Weighted { row: 0, point: ScoredPoint { position, score }, opacity: 0.9, reach: 0.01 }
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
        // Floaters are members of no answer, and nothing else is missing.
        let kept = clustered(&points, DENSITY, ALL).members;
        assert_eq!(kept.len(), 600);
        assert!(kept.iter().all(|&at| points[at].point.score < 0.95), "the floaters' is 0.99");

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
    fn clusters_are_those_of_a_search_of_all() {
        // Dense heaps (many to a block), thin air and large ones between.
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut points: Vec<Weighted> = Vec::new();
        for heap in 0..30 {
            let mut at = |half: f32| random.random_range(-half..half);
            let (center, wide) =
                (Point3::new(at(1.0), at(1.0), at(0.3)), 0.02 * (1 + heap % 8) as f32);
            for _ in 0..3 * heap {
                let offset = nalgebra::vector![at(wide), at(wide), at(wide)];
                let reach = at(1.0).abs().powi(6) * 0.1;
                points.push(Weighted { reach, ..weighted(center + offset, 0.5) });
            }
        }
        let density = Density { metres: 0.08, points: 1 };
        let is_near = |a: usize, b: usize| {
            let (one, other) = (&points[a], &points[b]);
            let apart = (one.point.position - other.point.position).norm();
            a == b || apart - one.reach - other.reach < density.metres
        };
        let all = 0..points.len();
        let is_core = |a: usize| all.clone().filter(|&b| is_near(a, b)).count() >= NEIGHBOURS;
        let cores: Vec<usize> = all.clone().filter(|&a| is_core(a)).collect();
        // Of cores: the least index that can be walked to.
        let mut least: Vec<usize> = all.clone().collect();
        loop {
            let before = least.clone();
            for &a in &cores {
                let near = cores.iter().filter(|&&b| is_near(a, b));
                least[a] = near.map(|&b| least[b]).min().unwrap();
            }
            if before == least {
                break;
            }
        }
        let near = Neighbours::new(&points, density.metres);
        let found = clusters(&near, &near.cores(), density.points);
        assert!((3..20).contains(&found.len()), "{} clusters", found.len());
        let mut cluster_of = vec![usize::MAX; points.len()];
        for (at, members) in found.iter().enumerate() {
            members.iter().for_each(|&member| cluster_of[member] = at);
        }
        for (i, &a) in cores.iter().enumerate() {
            for &b in &cores[..i] {
                assert_eq!(cluster_of[a] == cluster_of[b], least[a] == least[b], "{a} {b}");
            }
        }
        for a in all.clone().filter(|a| !cores.contains(a)) {
            let nearest = cores.iter().filter(|&&b| is_near(a, b));
            let ways: Vec<usize> = nearest.map(|&b| cluster_of[b]).collect();
            let placed = cluster_of[a];
            assert!(ways.contains(&placed) || (ways.is_empty() && placed == usize::MAX), "{a}");
        }
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
