//! Who is pruned, cloned and split, and where everybody goes.

use super::{CHANNELS, LENGTHS, RULES, map, pick};
use crate::support;

use crate::oracle::densify::{self as oracle, Fate};
use lexsplat_gpu::shader::layout::{CHILD, FRESH, INDEX_MASK};
use lexsplat_gpu::{DensifyCounts, DensifyRules, Gpu, GpuError, HostGaussians, Statistics};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Statistics around every limit of [`RULES`]; some are exactly on one.
pub fn seen(seed: u64, count: usize) -> Vec<Statistics> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut one = |_| {
        let views = rng.random_range(0..4) as f32;
        let on_limit = rng.random_range(0..8) == 0;
        let factor = if on_limit { 1.0 } else { rng.random_range(0.0f32..2.0) };
        Statistics {
            gradient_sum: factor * RULES.min_gradient * views,
            views,
            largest_radius: [0.0, 40.0, 40.1, 12.0][rng.random_range(0..4)],
            weight_sum: rng.random_range(0.0..9.0),
            touched_pixels: 3.0,
            largest_weight: 0.5,
        }
    };
    (0..count).map(&mut one).collect()
}

/// Where children went on the device, and the same map with them back at their parents.
fn undo_children(found: &HostGaussians, source: &[u32]) -> HostGaussians {
    let mut found = found.clone();
    for (slot, _) in source.iter().enumerate().filter(|(_, entry)| **entry & CHILD != 0) {
        found.means[slot] = [0.0; 3];
        for head in [&mut found.color, &mut found.language] {
            head.log_scales[slot] = [0.0; 3];
        }
    }
    found
}

/// As [`undo_children`], and the source's parameters at every other slot.
fn expected(host: &HostGaussians, source: &[u32]) -> HostGaussians {
    let index: Vec<u32> = source.iter().map(|entry| entry & INDEX_MASK).collect();
    undo_children(&pick(host, &index), source)
}

fn counts(fates: &[Fate], source: &[u32]) -> DensifyCounts {
    let split = source.iter().filter(|entry| **entry & CHILD != 0).count() / 2;
    let cloned = source.iter().filter(|entry| **entry & (FRESH | CHILD) == FRESH).count();
    let pruned = fates.iter().filter(|fate| **fate == Fate::Pruned).count();
    DensifyCounts { cloned, split, pruned, len: source.len() }
}

/// Densifies on both sides; returns what the device made and what the oracle wanted of it.
pub fn densified(
    gpu: &Gpu,
    host: &HostGaussians,
    statistics: &[Statistics],
    rules: &DensifyRules,
) -> ((DensifyCounts, HostGaussians), (DensifyCounts, Vec<u32>)) {
    let mut map = map(gpu, host);
    map.set_statistics(statistics).expect("one each");
    let found = map.densify(rules).expect("fits");
    assert_eq!(found.len, map.len());
    let arguments = rules.arguments(host.len()).expect("rules are numbers");
    let fates = oracle::decide(host, statistics, &arguments);
    let source = oracle::source(&fates, rules.max_gaussians);
    ((found, map.to_host().expect("reads")), (counts(&fates, &source), source))
}

#[test]
fn decisions_and_slots_are_the_oracles() {
    let gpu = support::gpu();
    let off = DensifyRules { max_scale: None, max_radius: None, min_opacity: 0.0, ..RULES };
    let either = DensifyRules { either_head: true, ..RULES };
    for len in LENGTHS {
        let host = support::scene(len as u64, len, CHANNELS, 0.05);
        let statistics = seen(len as u64, len);
        for rules in [&RULES, &off, &either] {
            let (found, wanted) = densified(&gpu, &host, &statistics, rules);
            assert_eq!(found.0, wanted.0, "{len} gaussians, {rules:?}");
            let (found, source) = (undo_children(&found.1, &wanted.1), wanted.1);
            assert!(found == expected(&host, &source), "{len} gaussians, {rules:?}");
            if len > 1000 {
                let all = wanted.0.cloned.min(wanted.0.split);
                assert!(all > 20, "every kind of birth is there: {:?}", wanted.0);
                let mut other = source;
                other.swap(0, found.len() - 1);
                assert!(found != expected(&host, &other), "two that changed places must show");
            }
        }
    }
}

#[test]
fn every_rule_prunes_and_switching_it_off_does_not() {
    let gpu = support::gpu();
    let host = support::scene(5, 800, CHANNELS, 0.05);
    let statistics = seen(5, 800);
    let none = DensifyRules {
        min_gradient: f32::INFINITY,
        min_opacity: 0.0,
        max_scale: None,
        max_radius: None,
        ..RULES
    };
    let pruned = |rules: &DensifyRules| densified(&gpu, &host, &statistics, rules).0.0.pruned;
    assert_eq!(pruned(&none), 0);
    let large = DensifyRules { max_scale: RULES.max_scale, ..none.clone() };
    for rules in [
        DensifyRules { min_opacity: RULES.min_opacity, ..none.clone() },
        DensifyRules { max_radius: RULES.max_radius, ..none.clone() },
        large.clone(),
    ] {
        assert!(pruned(&rules) > 10, "{rules:?}");
    }
    assert!(pruned(&DensifyRules { either_head: true, ..large.clone() }) > pruned(&large));
    for wrong in [
        DensifyRules { min_opacity: 1.5, ..none.clone() },
        DensifyRules { min_gradient: f32::NAN, ..none.clone() },
        DensifyRules { max_scale: Some(-1.0), ..none.clone() },
        DensifyRules { clone_scale: f32::NAN, ..none.clone() },
        DensifyRules { max_radius: Some(f32::NAN), ..none.clone() },
    ] {
        let error = map(&gpu, &host).densify(&wrong).expect_err("no rule");
        assert!(matches!(error, GpuError::BadValue { .. }), "{wrong:?}: {error}");
    }
}

#[test]
fn the_limit_holds_and_is_reached_in_order() {
    let gpu = support::gpu();
    let host = support::scene(6, 1000, CHANNELS, 0.05);
    let statistics = seen(6, 1000);
    let free = densified(&gpu, &host, &statistics, &RULES).0.0;
    let kept = 1000 - free.pruned;
    for max_gaussians in [0, kept - 1, kept, kept + 1, kept + 57, free.len - 1, free.len] {
        let rules = DensifyRules { max_gaussians, ..RULES };
        let (found, wanted) = densified(&gpu, &host, &statistics, &rules);
        assert_eq!(found.0, wanted.0, "at most {max_gaussians}");
        assert_eq!(found.0.len, max_gaussians.max(kept), "at most {max_gaussians}");
        assert_eq!(found.0.pruned, free.pruned, "births are cut, nothing else");
        assert!(undo_children(&found.1, &wanted.1) == expected(&host, &wanted.1));
    }
}

#[test]
fn what_is_not_a_number_goes_and_harms_nobody() {
    let gpu = support::gpu();
    let mut host = support::scene(8, 200, CHANNELS, 0.05);
    let mut statistics = seen(8, 200);
    for (i, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        host.color.log_scales[10 + i][1] = bad;
        host.language.log_scales[20 + i][2] = bad;
        host.color.opacity_logits[30 + i] = bad;
        host.language.opacity_logits[30 + i] = bad;
        statistics[40 + i].gradient_sum = bad;
        statistics[50 + i].largest_radius = bad;
        host.color.rotations[60 + i] = [bad; 4];
        host.color.log_scales[60 + i] = [-2.4; 3];
        statistics[60 + i] = Statistics { gradient_sum: 1.0, views: 1.0, ..Statistics::default() };
        host.means[70 + i][i] = bad;
    }
    host.color.rotations[64] = [0.0; 4];
    let rules = DensifyRules { max_scale: None, ..RULES };
    let (found, wanted) = densified(&gpu, &host, &statistics, &rules);
    assert_eq!(found.0, wanted.0);
    assert_eq!(found.1.means.len(), found.0.len);
    assert!(found.1.means.iter().flatten().all(|v| v.is_finite()), "children stay somewhere");
}
