//! Morton order: exactly the oracle's, near each other, and nothing else changed.

use super::{CHANNELS, LENGTHS, map, pick};
use crate::support;

use crate::oracle;
use lexsplat_gpu::{Camera, Renderer};
use nalgebra::{Isometry3, Vector3};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

#[test]
fn morton_order_is_the_oracles() {
    let gpu = support::gpu();
    for len in LENGTHS {
        let mut host = support::scene(len as u64, len, CHANNELS, 0.05);
        let poison = [f32::NAN, f32::INFINITY, -1e35];
        for (i, bad) in poison.into_iter().enumerate().filter(|_| len > 63) {
            host.means[7 * i][i] = bad;
        }
        let mut map = map(&gpu, &host);
        map.reorder_morton().expect("fits");
        let order = oracle::morton::order(&host.means);
        let bits = |means: &[[f32; 3]]| means.iter().flatten().map(|v| v.to_bits()).collect();
        let (found, wanted) = (map.to_host().expect("reads"), pick(&host, &order));
        let (found_bits, wanted_bits): (Vec<u32>, Vec<u32>) =
            (bits(&found.means), bits(&wanted.means));
        assert_eq!(found_bits, wanted_bits, "{len} gaussians");
        assert!((&found.color, &found.language) == (&wanted.color, &wanted.language));
        if len > 63 {
            let last: Vec<u32> = order[len - 3..].to_vec();
            assert_eq!(last, [0, 7, 14], "what has no place is last, in order");
            assert!(bits(&host.means) != found_bits, "the order did change");
        }
    }
}

#[test]
fn the_oracles_codes_are_known_ones() {
    let code = |mean| oracle::morton::code(mean, [0.0; 3], [1.0, 2.0, 4.0]);
    assert_eq!(code([0.0; 3]), 0);
    assert_eq!(code([1.0, 2.0, 4.0]), (1 << 30) - 1);
    assert_eq!(code([1.0, 0.0, 0.0]), 0x0924_9249);
    assert_eq!(code([0.0, 0.0, 2.0]), 1 << 29);
    assert_eq!(code([0.0, f32::NAN, 0.0]), 1 << 30);
}

#[test]
fn equal_or_infinite_means_keep_their_order() {
    let gpu = support::gpu();
    for mean in [[1.0, 2.0, 3.0], [f32::NAN; 3]] {
        let mut host = support::scene(3, 300, CHANNELS, 0.05);
        host.means = vec![mean; 300];
        let mut map = map(&gpu, &host);
        map.reorder_morton().expect("fits");
        let found = map.to_host().expect("reads");
        assert!((found.color, found.language) == (host.color, host.language));
    }
}

#[test]
fn morton_order_brings_neighbours_together_and_leaves_the_picture() {
    let gpu = support::gpu();
    let mut host = support::scene(14, 5000, CHANNELS, 0.02);
    host.means.shuffle(&mut ChaCha8Rng::seed_from_u64(14));
    let mut map = map(&gpu, &host);
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = Camera { camera_from_world: Isometry3::identity(), ..support::camera(96, 72) };
    let step = |means: &[[f32; 3]]| {
        let apart = |pair: &[[f32; 3]]| (Vector3::from(pair[0]) - Vector3::from(pair[1])).norm();
        means.windows(2).map(apart).sum::<f32>() / (means.len() - 1) as f32
    };
    let before = renderer.render_color(&map, &camera).expect("renders");
    map.reorder_morton().expect("fits");
    let after = renderer.render_color(&map, &camera).expect("renders");
    // No two depths are the same here, so lists are in the same order and sums have the same bits.
    assert!(before == after, "the picture is the same");
    let (far, near) = (step(&host.means), step(&map.read_means().expect("reads")));
    println!("consecutive gaussians: {far} m apart, then {near} m");
    assert!(near < far / 6.0, "measured a factor of 8.1: {far} to {near}");
    let once = map.to_host().expect("reads");
    map.reorder_morton().expect("fits");
    assert!(map.to_host().expect("reads") == once, "an order is kept");
}
