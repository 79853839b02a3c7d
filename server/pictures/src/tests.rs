//! Features of a painted wall from two places, in two exposures.

use crate::{Features, Picture};

const WIDTH: usize = 200;
const HEIGHT: usize = 150;

/// The features of patches of random brightness on a wall `depth` metres away, seen `shift` metres further to
/// the right with a gain.
fn wall(depth: f32, shift: f32, gain: f32, seed: u32) -> Features {
    measured_wall(depth, shift, gain, seed, depth)
}

/// The same with another depth than the wall's.
fn measured_wall(depth: f32, shift: f32, gain: f32, seed: u32, measured: f32) -> Features {
    let (focal, [cx, cy]) = (180.0, [99.5, 74.5]);
    let patch = |x: f32| (x * 16.0 + 1000.0).floor() as u32;
    let grey = |at: usize| {
        let (u, v) = ((at % WIDTH) as f32, (at / WIDTH) as f32);
        let x = (u - cx) / focal * depth + shift;
        let y = (v - cy) / focal * depth;
        let mixed = patch(y).wrapping_mul(40_503).wrapping_add(seed).wrapping_mul(2_246_822_519);
        let hash = patch(x).wrapping_mul(2_654_435_761) ^ mixed;
        let noise = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d) >> 24;
        (gain * (30.0 + 0.4 * noise as f32)) as u8
    };
    let rgb: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(|at| [grey(at); 3]).collect();
    Features::detect(&Picture {
        width: WIDTH,
        height: HEIGHT,
        focal: [focal; 2],
        centre: [cx, cy],
        rgb: &rgb,
        depth_metres: &vec![measured; WIDTH * HEIGHT],
    })
}

/// Share of the matches that are within 2 cm of the shift between the images.
fn right(a: &Features, b: &Features, shift: f64) -> (usize, f64) {
    let pairs = a.matches(b);
    let off = |(i, j): &(usize, usize)| {
        let motion = a.point(*i) - b.point(*j);
        ((motion.x - shift).powi(2) + motion.y.powi(2)).sqrt()
    };
    let near = pairs.iter().filter(|pair| off(pair) < 0.02).count();
    (pairs.len(), near as f64 / pairs.len().max(1) as f64)
}

#[test]
fn corners_are_matched_after_a_step_aside_in_another_exposure() {
    let here = wall(1.5, 0.0, 1.0, 0);
    let aside = wall(1.5, 0.3, 1.8, 0);
    let (count, share) = right(&here, &aside, 0.3);
    println!("{count} matches, {share:.2} right");
    // Measured 156 and 1.00.
    assert!(count > 100 && share > 0.95, "{count} {share}");
    let (_, wrong) = right(&here, &aside, 0.1);
    assert!(wrong < 0.2, "another motion does not explain them: {wrong}");
}

#[test]
fn another_place_does_not_match() {
    let here = wall(1.5, 0.0, 1.0, 0);
    let same = wall(1.5, 0.2, 0.7, 0);
    let other = wall(1.5, 0.0, 1.0, 77);
    let (same, other) = (here.similarity(&same), here.similarity(&other));
    println!("{same} {other}");
    // Measured 83 and 27: the patches of all walls have the same corners.
    assert!(same > 2 * other + 10, "{same} {other}");
}

#[test]
fn an_image_without_corners_or_depth_has_no_features() {
    let plain = wall(1.5, 0.0, 0.0, 0);
    assert!(plain.matches(&plain).is_empty());
    assert_eq!(measured_wall(1.5, 0.0, 1.0, 0, 0.0).bytes(), 0);
    assert!(wall(1.5, 0.0, 1.0, 0).bytes() > 0, "negative control");
}
