//! Neighbours, clusters and objects of synthetic Gaussians.

use super::clusters::{ClusterLimits, clusters};
use super::gaussian::RelevantGaussian;
use super::neighbours::{MIN_NEIGHBOURS, Neighbours};
use super::objects::ObjectLimits;
use crate::pipeline::query::answer::{Object, ScoredPoint};
use nalgebra::Point3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const NO_LIMITS: ObjectLimits = ObjectLimits { threshold: 0.5, score: 0.0, size: 0.0 };

/// All segments are relevant.
fn whole(relevant: &[RelevantGaussian]) -> Vec<f32> {
    vec![1.0; relevant.len()]
}

/// The objects, best first, and the indices of all their members.
fn find_objects(
    relevant: &[RelevantGaussian],
    shares: &[f32],
    clustering: ClusterLimits,
    limits: ObjectLimits,
) -> (Vec<Object>, Vec<usize>) {
    let found = super::objects::find_objects(relevant, shares, clustering, limits);
    let members = found.iter().flat_map(|one| one.members.iter().copied()).collect();
    (found.into_iter().map(|one| one.object).collect(), members)
}

fn objects(relevant: &[RelevantGaussian], clustering: ClusterLimits) -> Vec<Object> {
    find_objects(relevant, &whole(relevant), clustering, NO_LIMITS).0
}

#[test]
fn small_and_doubtful_clusters_are_dropped_beside_a_better_one() {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let mut points = blob(Point3::origin(), 0.9, &mut random);
    // Three more: as relevant and as large; as relevant and small; as large and doubtful.
    points.extend(blob(Point3::new(1.0, 0.0, 0.0), 0.8, &mut random));
    points.extend(
        blob(Point3::new(2.0, 0.0, 0.0), 0.9, &mut random)
            .drain(..)
            .take(20)
            .map(|one| RelevantGaussian { radius: 0.2, ..one }),
    );
    points.extend(blob(Point3::new(3.0, 0.0, 0.0), 0.6, &mut random));
    assert_eq!(objects(&points, CLUSTERING).len(), 4);
    let limits = ObjectLimits { threshold: 0.5, score: 0.5, size: 0.1 };
    let (objects_found, members) = find_objects(&points, &whole(&points), CLUSTERING, limits);
    assert_eq!((objects_found.len(), members.len()), (2, 600));
    // A single object is reported however doubtful it is.
    let alone = blob(Point3::origin(), 0.55, &mut random);
    assert_eq!(find_objects(&alone, &whole(&alone), CLUSTERING, limits).0.len(), 1);
    assert!(find_objects(&[], &[], CLUSTERING, limits).0.is_empty());
}

#[test]
fn patches_of_larger_things_are_dropped_beside_a_whole_thing() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut points = blob(Point3::origin(), 0.9, &mut random);
    points.extend(blob(Point3::new(1.0, 0.0, 0.0), 0.9, &mut random));
    let shares = |second: f32| [vec![0.8; 300], vec![second; 300]].concat();
    let found = |shares: &[f32]| find_objects(&points, shares, CLUSTERING, NO_LIMITS);
    let (objects_found, members) = found(&shares(0.4));
    assert!(objects_found.len() == 1 && members.iter().all(|&at| at < 300), "{objects_found:?}");
    // Negative control: both are whole.
    assert_eq!(found(&shares(0.7)).0.len(), 2);
    // The best patch is reported if there is nothing else.
    let patches = [vec![0.3; 300], vec![0.1; 300]].concat();
    assert_eq!(found(&patches).1, (0..300).collect::<Vec<_>>());
}

#[test]
fn objects_on_a_slightly_relevant_surface_are_separate() {
    let mut random = ChaCha8Rng::seed_from_u64(10);
    let mut points = blob(Point3::origin(), 0.9, &mut random);
    points.extend(blob(Point3::new(1.0, 0.0, 0.0), 0.9, &mut random));
    points.extend((0..100).map(|i| gaussian(Point3::new(0.01 * i as f32, 0.0, 0.0), 0.6)));
    let limits = ObjectLimits { threshold: 0.5, score: 0.5, size: 0.0 };
    let (objects_found, members) = find_objects(&points, &whole(&points), CLUSTERING, limits);
    assert_eq!(objects_found.len(), 2);
    assert!((600..680).contains(&members.len()), "{}", members.len());
    // Negative control: without limits all Gaussians are core points, and there is one object.
    assert_eq!(objects(&points, CLUSTERING).len(), 1);
}

const CLUSTERING: ClusterLimits = ClusterLimits { eps_metres: 0.08, min_members: 8 };

fn gaussian(position: Point3<f32>, score: f32) -> RelevantGaussian {
    RelevantGaussian {
        row: 0,
        point: ScoredPoint { position, score },
        opacity: 0.9,
        spread: 0.2,
        radius: 0.01,
    }
}

fn blob(center: Point3<f32>, score: f32, random: &mut ChaCha8Rng) -> Vec<RelevantGaussian> {
    let mut offset = || random.random_range(-0.15_f32..0.15);
    (0..300)
        .map(|_| gaussian(center + nalgebra::vector![offset(), offset(), offset()], score))
        .collect()
}

#[test]
fn two_blobs_with_noise_are_two_objects() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut points = blob(Point3::new(0.0, 0.0, 0.0), 0.7, &mut random);
    points.extend(blob(Point3::new(1.0, 0.0, 0.2), 0.9, &mut random));
    for i in 0..20 {
        points.push(gaussian(Point3::new(-1.0 - 0.5 * i as f32, 2.0, 0.0), 0.99));
    }
    let found = objects(&points, CLUSTERING);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!((found[0].center - Point3::new(1.0, 0.0, 0.2)).norm() < 0.03, "{:?}", found[0]);
    assert!((found[1].center - Point3::origin()).norm() < 0.03, "{:?}", found[1]);
    assert!((found[0].score - 0.9).abs() < 1e-5 && (found[1].score - 0.7).abs() < 1e-5);
    assert_eq!((found[0].points, found[1].points), (300, 300));
    // Noise belongs to no object, and no other Gaussian is missing.
    let kept = find_objects(&points, &whole(&points), CLUSTERING, NO_LIMITS).1;
    assert_eq!(kept.len(), 600);
    assert!(kept.iter().all(|&at| points[at].point.score < 0.95), "noise has 0.99");

    // Negative controls: with a larger eps they are one object; a minimum of a thousand leaves
    // none.
    let merged = objects(&points, ClusterLimits { eps_metres: 0.8, min_members: 8 });
    assert!(merged.iter().any(|object| object.points == 600), "{merged:?}");
    assert!(objects(&points, ClusterLimits { eps_metres: 0.08, min_members: 1000 }).is_empty());
}

#[test]
fn few_large_gaussians_are_an_object() {
    // A chair seen from afar: Gaussians at distances of 18 cm.
    let far: Vec<_> = (0..12)
        .map(|i| gaussian(Point3::new(0.18 * (i % 4) as f32, 0.18 * (i / 4) as f32, 5.0), 0.9))
        .collect();
    assert!(objects(&far, CLUSTERING).is_empty(), "small ones are noise");
    let large: Vec<_> = far.iter().map(|one| RelevantGaussian { radius: 0.15, ..*one }).collect();
    let found = objects(&large, CLUSTERING);
    assert_eq!((found.len(), found[0].points), (1, 12));
    // An object at a distance of half a metre stays separate in spite of the large radii.
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut both = large;
    both.extend(blob(Point3::new(0.3, 1.2, 5.0), 0.8, &mut random));
    assert_eq!(objects(&both, CLUSTERING).len(), 2);
}

#[test]
fn neighbours_match_an_exhaustive_search() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let points: Vec<_> = (0..400)
        .map(|_| {
            let mut at = || random.random_range(-1.0_f32..1.0);
            let position = Point3::new(at(), at(), at());
            let radius = random.random_range(0.0_f32..0.2);
            RelevantGaussian { radius: radius * radius * 5.0, ..gaussian(position, 0.5) }
        })
        .collect();
    let near = Neighbours::new(&points, 0.08);
    let mut pairs_found = near.pairs();
    pairs_found.sort_unstable();
    let mut expected_pairs = Vec::new();
    let mut pairs = 0;
    for at in 0..points.len() {
        let mut found: Vec<usize> = near.of(at).collect();
        found.sort_unstable();
        let expected: Vec<usize> =
            (0..points.len()).filter(|&other| other == at || near.gap(at, other) < 0.08).collect();
        assert_eq!(found, expected, "{at}");
        pairs += found.len() - 1;
        let later = found.iter().filter(|&&other| other > at);
        expected_pairs.extend(later.map(|&other| [at as u32, other as u32]));
    }
    assert_eq!(pairs_found, expected_pairs);
    assert!(pairs > 400, "{pairs}");
}

#[test]
fn clusters_match_an_exhaustive_search() {
    // Dense heaps with many points to a block, sparse ones, and some large radii.
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut points: Vec<RelevantGaussian> = Vec::new();
    for heap in 0..30 {
        let mut at = |half: f32| random.random_range(-half..half);
        let (center, wide) = (Point3::new(at(1.0), at(1.0), at(0.3)), 0.02 * (1 + heap % 8) as f32);
        for _ in 0..3 * heap {
            let offset = nalgebra::vector![at(wide), at(wide), at(wide)];
            let radius = at(1.0).abs().powi(6) * 0.1;
            points.push(RelevantGaussian { radius, ..gaussian(center + offset, 0.5) });
        }
    }
    let clustering = ClusterLimits { eps_metres: 0.08, min_members: 1 };
    let is_near = |a: usize, b: usize| {
        let (one, other) = (&points[a], &points[b]);
        let apart = (one.point.position - other.point.position).norm();
        a == b || apart - one.radius - other.radius < clustering.eps_metres
    };
    let all = 0..points.len();
    let is_core = |a: usize| all.clone().filter(|&b| is_near(a, b)).count() >= MIN_NEIGHBOURS;
    let cores: Vec<usize> = all.clone().filter(|&a| is_core(a)).collect();
    // For core points: the least index that is connected to them.
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
    let near = Neighbours::new(&points, clustering.eps_metres);
    let found = clusters(&near, &near.core_points(), clustering.min_members);
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
        let candidates: Vec<usize> = nearest.map(|&b| cluster_of[b]).collect();
        let cluster = cluster_of[a];
        assert!(
            candidates.contains(&cluster) || (candidates.is_empty() && cluster == usize::MAX),
            "{a}"
        );
    }
}

#[test]
fn an_object_has_the_score_of_its_best_quarter() {
    let at = |i: usize| Point3::new(0.001 * i as f32, 0.0, 0.0);
    let points: Vec<_> = (0..40).map(|i| gaussian(at(i), if i < 10 { 0.9 } else { 0.5 })).collect();
    let found = objects(&points, CLUSTERING);
    assert_eq!(found.len(), 1);
    assert!((found[0].score - 0.9).abs() < 1e-6, "{}", found[0].score);
}
