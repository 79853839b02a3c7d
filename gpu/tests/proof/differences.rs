//! The oracle's gradients against central differences, in f64, for every parameter of both heads.
//! Needs no device. The loss is a random linear function of the picture, so that it has no kink;
//! the seeds keep pixels away from the cut-offs of alpha.

use crate::support;

use crate::oracle::Head;
use crate::oracle::project::View;
use nalgebra::Vector6;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEP: f64 = 1e-6;
/// With 3 an alpha crosses its cut-off within a step.
const SEEDS: [u64; 3] = [1, 2, 4];
/// Largest |analytic - difference| over 1 + |difference|; measured worst case: 2.9e-8, which is
/// what rounding leaves of a difference over 2 STEP.
const TOLERANCE: f64 = 2e-7;

fn head(color: bool, seed: u64) -> Head {
    let scene = support::scene(seed, 12, 5, 0.12);
    if color { Head::color(&scene) } else { Head::language(&scene) }
}

fn random(seed: u64, len: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn loss(head: &Head, view: &View, factors: &[f64]) -> f64 {
    head.render(view).image.iter().zip(factors).map(|(a, b)| a * b).sum()
}

/// Largest error of `gradient` against central differences, over all parameters, and its place.
fn worst(head: &Head, view: &View, factors: &[f64], gradient: &[f64]) -> (f64, usize) {
    let flat = head.flatten();
    let mut worst = (0.0, 0);
    for parameter in 0..flat.len() {
        let at = |offset: f64| {
            let mut moved = flat.clone();
            moved[parameter] += offset;
            loss(&head.with_flat(&moved), view, factors)
        };
        let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
        let error = (gradient[parameter] - difference).abs() / (1.0 + difference.abs());
        if error > worst.0 {
            worst = (error, parameter);
        }
    }
    worst
}

#[test]
fn gradients_of_both_heads_match_finite_differences() {
    let view = View::new(&support::camera(37, 29));
    for color in [true, false] {
        for seed in SEEDS {
            let head = head(color, seed);
            let factors = random(seed, 37 * 29 * head.picture_channels());
            let gradient = head.gradients(&view, &factors).flatten();
            let (error, place) = worst(&head, &view, &factors, &gradient);
            println!("color {color} seed {seed}: {error:.1e} at {place}");
            let moved = gradient.iter().filter(|g| g.abs() > 1e-3).count();
            assert!(moved > gradient.len() / 2, "most parameters matter: {moved}");
            assert!(error < TOLERANCE, "color {color} seed {seed}: {error:.1e} at {place}");
        }
    }
}

/// Largest error of a pose gradient against central differences, as [`worst`].
fn worst_pose(head: &Head, view: &View, factors: &[f64], gradient: &Vector6<f64>) -> f64 {
    let error = |axis: usize| {
        let at = |offset: f64| {
            let mut tau = Vector6::zeros();
            tau[axis] = offset;
            loss(head, &view.perturbed(&tau), factors)
        };
        let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
        (gradient[axis] - difference).abs() / (1.0 + difference.abs())
    };
    (0..6).map(error).fold(0.0, f64::max)
}

/// Measured worst case: 3.8e-9.
#[test]
fn the_pose_gradient_matches_finite_differences() {
    let view = View::new(&support::camera(37, 29));
    for seed in SEEDS {
        let head = head(true, seed);
        let factors = random(seed, 37 * 29 * head.picture_channels());
        let gradient = head.pose_gradient(&view, &factors);
        let error = worst_pose(&head, &view, &factors, &gradient);
        println!("pose seed {seed}: {error:.1e}, {gradient:?}");
        assert!(error < TOLERANCE, "seed {seed}: {error:.1e}");
        for axis in 0..6 {
            let mut wrong = gradient;
            wrong[axis] *= 1.001;
            let control = worst_pose(&head, &view, &factors, &wrong);
            assert!(control > TOLERANCE, "seed {seed} axis {axis}: {control:.1e}");
        }
    }
}

#[test]
fn a_wrong_gradient_is_noticed_for_every_kind_of_parameter() {
    let view = View::new(&support::camera(37, 29));
    let head = head(true, 1);
    let factors = random(1, 37 * 29 * head.picture_channels());
    let right = head.gradients(&view, &factors).flatten();
    for kind in 0..14 {
        let mut wrong = right.clone();
        let gaussian = (0..12).find(|g| right[g * 14 + kind].abs() > 1e-2).expect("one matters");
        wrong[gaussian * 14 + kind] *= 1.001;
        let (error, _) = worst(&head, &view, &factors, &wrong);
        assert!(error > TOLERANCE, "kind {kind}: {error:.1e}");
    }
}

#[test]
fn beyond_the_view_margin_the_jacobian_and_its_gradient_are_clamped() {
    let camera = support::camera(37, 29);
    let view = View::new(&camera);
    let mut head = head(true, 4);
    for (i, shape) in head.shapes.iter_mut().enumerate() {
        shape.mean.x = if i % 2 == 0 { 1.6 } else { -1.7 };
        shape.mean.z = 1.5;
        shape.log_scale.fill(-0.9 - 0.05 * i as f64);
    }
    let factors = random(4, 37 * 29 * head.picture_channels());
    let gradient = head.gradients(&view, &factors).flatten();
    let (error, place) = worst(&head, &view, &factors, &gradient);
    println!("outside: {error:.1e} at {place}");
    assert!(gradient.iter().any(|g| g.abs() > 1e-3), "it is seen from the side");
    assert!(error < TOLERANCE, "{error:.1e} at {place}");
}

/// The fault of the paper's released rasterisers (one pixel per tile feeds the code gradient) must
/// not pass for a gradient.
#[test]
fn a_code_gradient_from_one_pixel_per_tile_is_wrong() {
    let view = View::new(&support::camera(37, 29));
    let head = head(false, 2);
    let channels = head.channels;
    let factors = random(2, 37 * 29 * channels);
    let corner = |pixel: usize| (pixel % 37).is_multiple_of(16) && (pixel / 37).is_multiple_of(16);
    let corners: Vec<f64> = factors
        .iter()
        .enumerate()
        .map(|(i, factor)| if corner(i / channels) { *factor } else { 0.0 })
        .collect();
    let mut gradient = head.gradients(&view, &factors);
    gradient.features = head.gradients(&view, &corners).features;
    let (error, _) = worst(&head, &view, &factors, &gradient.flatten());
    assert!(error > 1e3 * TOLERANCE, "{error:.1e}");
}
