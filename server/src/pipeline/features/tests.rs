//! Features of a painted wall from two places, in two exposures.

use super::*;
use lexsplat_gpu::Camera;
use nalgebra::Isometry3;

/// Patches of random brightness on a wall `depth` metres away, seen `shift` metres further to the right
/// with a gain.
fn wall(depth: f32, shift: f32, gain: f32, seed: u32) -> DownsampledFrame {
    let (width, height) = (200usize, 150usize);
    let camera = Camera {
        width: 200,
        height: 150,
        fx: 180.0,
        fy: 180.0,
        cx: 99.5,
        cy: 74.5,
        camera_from_world: Isometry3::identity(),
    };
    let patch = |x: f32| (x * 16.0 + 1000.0).floor() as u32;
    let grey = |at: usize| {
        let (u, v) = ((at % width) as f32, (at / width) as f32);
        let x = (u - camera.cx) / camera.fx * depth + shift;
        let y = (v - camera.cy) / camera.fy * depth;
        let mixed = patch(y).wrapping_mul(40_503).wrapping_add(seed).wrapping_mul(2_246_822_519);
        let hash = patch(x).wrapping_mul(2_654_435_761) ^ mixed;
        let noise = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d) >> 24;
        (gain * (30.0 + 0.4 * noise as f32)) as u8
    };
    let rgb = (0..width * height).flat_map(|at| [grey(at); 3]).collect();
    DownsampledFrame { camera, rgb, depth_metres: vec![depth; width * height].into() }
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
    let here = Features::detect(&wall(1.5, 0.0, 1.0, 0));
    let aside = Features::detect(&wall(1.5, 0.3, 1.8, 0));
    let (count, share) = right(&here, &aside, 0.3);
    println!("{count} matches, {share:.2} right");
    // Measured 156 and 1.00.
    assert!(count > 100 && share > 0.95, "{count} {share}");
    let (_, wrong) = right(&here, &aside, 0.1);
    assert!(wrong < 0.2, "another motion does not explain them: {wrong}");
}

#[test]
fn another_place_does_not_match() {
    let here = Features::detect(&wall(1.5, 0.0, 1.0, 0));
    let same = Features::detect(&wall(1.5, 0.2, 0.7, 0));
    let other = Features::detect(&wall(1.5, 0.0, 1.0, 77));
    let (same, other) = (here.similarity(&same), here.similarity(&other));
    println!("{same} {other}");
    // Measured 83 and 27: the patches of all walls have the same corners.
    assert!(same > 2 * other + 10, "{same} {other}");
}

#[test]
fn an_image_without_corners_or_depth_has_no_features() {
    let plain = wall(1.5, 0.0, 0.0, 0);
    assert!(Features::detect(&plain).matches(&Features::detect(&plain)).is_empty());
    let blind =
        DownsampledFrame { depth_metres: vec![0.0; 30_000].into(), ..wall(1.5, 0.0, 1.0, 0) };
    assert_eq!(Features::detect(&blind).bytes(), 0);
}
