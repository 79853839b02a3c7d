//! Normal systems against the oracle, and Jacobians and gradients against differences.

use crate::room::{Bench, camera, motion};

use crate::oracle::align::{self as oracle, PixelResiduals};
use crate::oracle::pyramid::{self as levels, HostLevel};
use lexsplat_gpu::align::{Comparison, Robust, se3};
use lexsplat_gpu::{AlignSettings, Estimate, NormalSystem};
use nalgebra::{SVector, Vector6};

/// Worst measured 3e-5 (llvmpipe).
const SYSTEM_TOLERANCE: f64 = 1e-4;

/// Largest difference of two systems: sums relative to the largest of their kind, and counts.
fn difference(found: &NormalSystem, wanted: &NormalSystem) -> (f64, u32) {
    let scale = |i: usize| wanted.h[(i, i)].sqrt().max(1e-9);
    let mut worst: f64 = 0.0;
    for i in 0..8 {
        for j in 0..8 {
            let off = (found.h[(i, j)] - wanted.h[(i, j)]).abs();
            worst = worst.max(off / (scale(i) * scale(j)));
        }
        let off = (found.g[i] - wanted.g[i]).abs();
        worst = worst.max(off / (scale(i) * (2.0 * wanted.cost()).sqrt()));
    }
    let costs = [
        (found.photometric_cost, wanted.photometric_cost),
        (found.geometric_cost, wanted.geometric_cost),
    ];
    for (found, wanted) in costs {
        worst = worst.max((found - wanted).abs() / wanted.max(1e-9));
    }
    let counts = |system: &NormalSystem| {
        let c = system.counts;
        let inliers = [c.photometric_inliers, c.geometric_inliers];
        [
            c.live,
            c.inside,
            c.photometric,
            c.geometric,
            inliers[0],
            inliers[1],
            c.visible,
            c.agreeing,
            c.meeting,
        ]
    };
    let pairs = counts(found).into_iter().zip(counts(wanted));
    (worst, pairs.map(|(found, wanted)| found.abs_diff(wanted)).max().unwrap_or(0))
}

/// A part of [`motion`]: 0 for none, 1 for all.
pub fn on_the_way(part: f64) -> Estimate {
    let tau = se3::log(&motion().reference_from_live) * part;
    let exposure = motion().exposure.map(|v| v * part);
    Estimate { reference_from_live: se3::exp(&tau), exposure }
}

#[test]
fn systems_match_the_oracle() {
    let mut bench = Bench::new();
    let mut worst: (f64, u32) = (0.0, 0);
    for (size, stride, geometric_robust, normal_gate, depth_noise) in [
        ((40, 30), 1, Robust::Huber, 0.8, 0.0),
        ((67, 45), 1, Robust::Cauchy, -1.0, 0.004),
        ((67, 45), 7, Robust::Huber, 0.8, 0.0),
        ((160, 90), 1, Robust::Huber, 0.8, 0.002),
        ((161, 91), 4, Robust::Cauchy, 0.9, 0.0),
    ] {
        let pair = bench.pair(size, 2, 0.1);
        let settings = AlignSettings {
            stride,
            geometric_robust,
            normal_gate,
            depth_noise,
            photometric_threshold: 0.05,
            geometric_threshold: 0.02,
            depth_gate: 0.1,
            ..AlignSettings::default()
        };
        for (reference, live) in pair.0.levels().iter().zip(pair.1.levels()) {
            let hosts = (bench.host(reference), bench.host(live));
            // Not the motion itself, where residuals are nothing but rounding.
            for part in [0.01, 0.6, 0.95] {
                let estimate = on_the_way(part);
                let found =
                    bench.aligner.system(reference, live, &estimate, &settings).expect("sums");
                let wanted = |estimate| oracle::system((&hosts.0, &hosts.1), estimate, &settings);
                let off = difference(&found, &wanted(&estimate));
                worst = (worst.0.max(off.0), worst.1.max(off.1));
                let (moved, _) = difference(&found, &wanted(&on_the_way(part + 0.01)));
                assert!(moved > 10.0 * SYSTEM_TOLERANCE, "0.3 mm, 0.02 degrees: {moved}");
                let other = AlignSettings { photometric_weight: 1.01e3, ..settings };
                let other = oracle::system((&hosts.0, &hosts.1), &estimate, &other);
                assert!(difference(&found, &other).0 > 10.0 * SYSTEM_TOLERANCE);
            }
        }
    }
    println!("worst {worst:?}");
    assert!(worst.0 < SYSTEM_TOLERANCE && worst.1 == 0, "{worst:?}");
}

#[test]
fn several_comparisons_share_the_pixels() {
    let mut bench = Bench::new();
    let (reference, live) = bench.pair((161, 91), 2, 0.1);
    let settings = AlignSettings { stride: 6, depth_gate: 0.1, ..AlignSettings::default() };
    // The last has a fourth of the pixels.
    let compared = [(0, 0, 0.3), (1, 0, 0.5), (0, 0, 0.7), (0, 1, 0.6)];
    let levels = |at: usize| {
        let (of, with, _) = compared[at];
        (&reference.levels()[of], &live.levels()[with])
    };
    let comparisons = compared.map(|(of, with, part)| Comparison {
        reference: &reference.levels()[of],
        live: &live.levels()[with],
        estimate: on_the_way(part),
    });
    let found = bench.aligner.systems(&comparisons, &settings).expect("sums");
    assert_eq!(found.len(), compared.len());
    for (at, found) in found.iter().enumerate() {
        let hosts = (bench.host(levels(at).0), bench.host(levels(at).1));
        let wanted = |phase| {
            let estimate = &comparisons[at].estimate;
            oracle::system_from((&hosts.0, &hosts.1), estimate, &settings, phase)
        };
        let phase = at as f64 / compared.len() as f64;
        let off = difference(found, &wanted(phase));
        // One pixel may lie at a threshold.
        assert!(off.0 < SYSTEM_TOLERANCE && off.1 <= 1, "{at}: {off:?}");
        let (others, _) = difference(found, &wanted(phase + 0.25));
        assert!(others > 10.0 * SYSTEM_TOLERANCE, "other pixels: {others}");
    }
}

#[test]
fn the_same_system_has_the_same_bits() {
    let mut bench = Bench::new();
    let (reference, live) = bench.pair((161, 90), 1, 0.1);
    let mut run = || {
        let levels = (&reference.levels()[0], &live.levels()[0]);
        let settings = AlignSettings::default();
        bench.aligner.system(levels.0, levels.1, &on_the_way(0.5), &settings).expect("sums")
    };
    let first = run();
    assert!((0..5).all(|_| run() == first));
}

/// A reference whose intensity is bilinear in (u, v), so that interpolation and its slopes are
/// exact, before a tilted plane; and a live level that sees the same plane.
fn smooth_pair() -> (HostLevel, HostLevel) {
    let camera = camera(48, 36);
    let mut bases = Vec::new();
    for v in 0..camera.height {
        for u in 0..camera.width {
            let (u, v) = (f64::from(u), f64::from(v));
            let depth = 2.0 / (1.0 + 0.004 * u - 0.003 * v);
            bases.push([0.2 + 0.006 * u + 0.009 * v - 0.0002 * u * v, depth]);
        }
    }
    let level = levels::finish(&camera, &bases);
    (level.clone(), level)
}

#[test]
fn jacobians_are_the_slopes_of_residuals() {
    let (reference, live) = smooth_pair();
    let settings = AlignSettings { depth_gate: 0.5, ..AlignSettings::default() };
    let estimate = on_the_way(0.7);
    let levels = (&reference, &live);
    let residuals = |estimate: &Estimate, pixel: usize| -> Option<[oracle::Residual; 2]> {
        let PixelResiduals { photometric, geometric, .. } =
            oracle::pixel(levels, estimate, &settings, pixel);
        Some([photometric?, geometric?])
    };
    let moved = |axis: usize, by: f64| {
        let mut step = SVector::<f64, 8>::zeros();
        step[axis] = by;
        let tau = Vector6::from_fn(|i, _| step[i]);
        Estimate {
            reference_from_live: se3::exp(&tau) * estimate.reference_from_live,
            exposure: [estimate.exposure[0] + step[6], estimate.exposure[1] + step[7]],
        }
    };
    let (mut worst, mut flipped, mut compared) = (0.0f64, 0.0f64, 0);
    for pixel in (0..reference.rows.len()).step_by(17) {
        let Some(here) = residuals(&estimate, pixel) else { continue };
        for axis in 0..8 {
            let h = 1e-6;
            let around = [moved(axis, h), moved(axis, -h)].map(|e| residuals(&e, pixel));
            let [Some(up), Some(down)] = around else { continue };
            for term in 0..2 {
                let slope = (up[term].value - down[term].value) / (2.0 * h);
                let found = here[term].jacobian[axis];
                worst = worst.max((found - slope).abs());
                flipped = flipped.max((-found - slope).abs());
                compared += 1;
            }
        }
    }
    println!("worst {worst:e} of {compared}");
    assert!(compared > 1000);
    // Measured 2e-9 at slopes of order 1.
    assert!(worst < 1e-7, "{worst}");
    assert!(flipped > 0.5, "a wrong sign must show: {flipped}");
}

#[test]
fn the_gradient_is_that_of_the_cost() {
    let (reference, live) = smooth_pair();
    let estimate = on_the_way(0.7);
    for geometric_robust in [Robust::Huber, Robust::Cauchy] {
        // Thresholds that split the residuals.
        let settings = AlignSettings {
            depth_gate: 0.5,
            photometric_threshold: 0.02,
            geometric_threshold: 0.01,
            geometric_robust,
            ..AlignSettings::default()
        };
        let system = |estimate: &Estimate| oracle::system((&reference, &live), estimate, &settings);
        let here = system(&estimate);
        assert!(here.counts.photometric_inliers < here.counts.photometric);
        assert!(here.counts.geometric_inliers < here.counts.geometric);
        for axis in 0..6 {
            let tau = Vector6::from_fn(|i, _| if i == axis { 1e-7 } else { 0.0 });
            let moved = |tau: Vector6<f64>| {
                let pose = se3::exp(&tau) * estimate.reference_from_live;
                system(&Estimate { reference_from_live: pose, ..estimate })
            };
            let (up, down) = (moved(tau), moved(-tau));
            assert_eq!(up.counts.inside, down.counts.inside, "a smooth point");
            let slope = (up.cost() - down.cost()) / 2e-7;
            let off = (slope - here.g[axis]).abs() / here.g.norm();
            println!("axis {axis}: {off:e}");
            assert!(off < 1e-4, "axis {axis}: {slope} {}", here.g[axis]);
            assert!((slope + here.g[axis]).abs() / here.g.norm() > 1e-3, "a sign must show");
        }
    }
}
