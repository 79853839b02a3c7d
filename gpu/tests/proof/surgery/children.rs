//! The children of splits: where they are, and what they do to the picture.

use super::densify::{densified, seen};
use super::{CHANNELS, RULES, map, pick};
use crate::support;

use crate::oracle::densify as oracle;
use lexsplat_gpu::shader::layout::SPLIT_SHRINK;
use lexsplat_gpu::{DensifyRules, Gpu, HostGaussians, Renderer, Statistics};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// One large tilted Gaussian, many times.
fn crowd(count: usize) -> HostGaussians {
    let mut host = support::scene(9, count, CHANNELS, 0.05);
    host.means = vec![[0.2, -0.1, 2.5]; count];
    for (head, scales) in
        [(&mut host.color, [0.3f32, 0.1, 0.02]), (&mut host.language, [0.05, 0.2, 0.3])]
    {
        head.rotations = vec![[0.9, 0.3, -0.4, 1.1]; count];
        head.log_scales = vec![scales.map(f32::ln); count];
        head.opacity_logits = vec![1.0; count];
    }
    host
}

const EVERY: Statistics = Statistics {
    gradient_sum: 1.0,
    views: 1.0,
    largest_radius: 0.0,
    weight_sum: 0.0,
    touched_pixels: 0.0,
    largest_weight: 0.0,
};

fn split_all(gpu: &Gpu, host: &HostGaussians, seed: u32) -> HostGaussians {
    let mut map = map(gpu, host);
    map.set_statistics(&vec![EVERY; host.len()]).expect("one each");
    let rules = DensifyRules { min_opacity: 0.0, max_scale: None, clone_scale: 0.0, seed, ..RULES };
    let counts = map.densify(&rules).expect("fits");
    assert_eq!(counts.split, host.len());
    map.to_host().expect("reads")
}

#[test]
fn children_are_the_oracles_and_drawn_from_the_color_heads_covariance() {
    let gpu = support::gpu();
    let (count, seed) = (20_000, 11);
    let host = crowd(count);
    let found = split_all(&gpu, &host, seed);
    assert_eq!(found.len(), 2 * count);
    let mut worst = [0.0f64; 2];
    let (mut mean, mut square) = (Vector3::zeros(), Matrix3::zeros());
    for (slot, child) in found.means.iter().enumerate() {
        let z = oracle::normal(seed, slot as u32 / 2, slot as u32 % 2);
        let (rotation, scale) = (host.color.rotations[0], host.color.log_scales[0]);
        let wanted = oracle::offset(rotation, scale, z);
        let offset = Vector3::from_fn(|i, _| f64::from(child[i]) - f64::from(host.means[0][i]));
        worst[0] = worst[0].max((offset - Vector3::from(wanted)).amax());
        for (head, before) in [(&found.color, &host.color), (&found.language, &host.language)] {
            for axis in 0..3 {
                let wanted = before.log_scales[0][axis] - SPLIT_SHRINK;
                let off = f64::from(head.log_scales[slot][axis] - wanted).abs();
                worst[1] = worst[1].max(off);
            }
        }
        mean += offset / (2 * count) as f64;
        square += offset * offset.transpose() / (2 * count) as f64;
    }
    println!("children: worst {worst:?}");
    assert!(worst[0] < 6e-6, "measured 3.0e-6 m, of up to 1.3 m, on llvmpipe: {}", worst[0]);
    assert!(worst[1] < 1e-6, "measured 0: {}", worst[1]);
    let [w, i, j, k] = host.color.rotations[0].map(f64::from);
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    let rotation = rotation.to_rotation_matrix().into_inner();
    let variance = |scales: [f32; 3]| {
        let variance = Vector3::from(scales.map(|s| f64::from(s).exp().powi(2)));
        rotation * Matrix3::from_diagonal(&variance) * rotation.transpose()
    };
    let wanted = variance(host.color.log_scales[0]);
    // Standard errors: 0.3 / sqrt(40 000) and 0.09 sqrt(2 / 40 000).
    assert!(mean.amax() < 4.0 * 0.0015, "{mean}");
    assert!((square - wanted).amax() < 4.0 * 0.00064, "{square} instead of {wanted}");
    let other = variance(host.language.log_scales[0]);
    assert!((square - other).amax() > 0.01, "the language head's would show");
}

#[test]
fn the_same_map_gives_the_same_children_and_another_seed_others() {
    let gpu = support::gpu();
    let host = support::scene(10, 700, CHANNELS, 0.05);
    let statistics = seen(10, 700);
    let first = densified(&gpu, &host, &statistics, &RULES).0;
    assert!(densified(&gpu, &host, &statistics, &RULES).0 == first, "bit for bit");
    let other = DensifyRules { seed: 8, ..RULES };
    let other = densified(&gpu, &host, &statistics, &other).0;
    assert_eq!(other.0, first.0);
    assert_ne!(other.1.means, first.1.means);
    assert_eq!(other.1.color, first.1.color);
}

fn mean_difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32
}

#[test]
fn a_split_changes_the_picture_little() {
    let gpu = support::gpu();
    let camera = support::camera(96, 72);
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let mut picture = |host: &HostGaussians| {
        renderer.render_color(&map(&gpu, host), &camera).expect("renders").rgb
    };
    let mut host = support::scene(12, 4000, CHANNELS, 0.03);
    let color = |mean: &[f32; 3]| mean.map(|v| 0.5 + 0.5 * (2.0 * v).sin());
    host.color.features = host.means.iter().flat_map(color).collect();
    let before = picture(&host);
    let children = split_all(&gpu, &host, 3);
    let firsts: Vec<u32> = (0..host.len() as u32).map(|i| 2 * i).collect();
    let split = mean_difference(&before, &picture(&children));
    let halved = mean_difference(&before, &picture(&pick(&children, &firsts)));
    let mut far = children;
    far.means.iter_mut().for_each(|mean| mean[0] += 0.2);
    let moved = mean_difference(&before, &picture(&far));
    let empty = mean_difference(&before, &vec![0.0; before.len()]);
    println!("split {split}, one child {halved}, moved {moved}, nothing {empty}");
    assert!(split < 0.07, "measured 0.054 on llvmpipe: {split}");
    assert!(halved > 2.0 * split && moved > 2.0 * split, "{halved}, {moved}");
}
