//! Removing Gaussians, growing, and writing parts of a map.

use super::densify::seen;
use super::{CHANNELS, LENGTHS, RULES, map, pick};
use crate::support;

use lexsplat_gpu::{
    Buffer, Camera, ColorTarget, DensifyCounts, DensifyRules, Gaussians, Gpu, GpuError,
    HostGaussians, LanguageTarget, LearningRates, LossWeights, Renderer, Statistics, Trainer,
    TrainingView,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn retain_by_either_kind_of_flags_is_a_filter() {
    let gpu = support::gpu();
    for len in LENGTHS {
        let host = support::scene(len as u64, len, CHANNELS, 0.05);
        let mut rng = ChaCha8Rng::seed_from_u64(len as u64);
        for share in [0.0, 0.5, 0.9, 1.0] {
            let flags: Vec<u32> = (0..len)
                .map(|_| if rng.random_bool(share) { rng.random_range(1..9) } else { 0 })
                .collect();
            let keep: Vec<bool> = flags.iter().map(|flag| *flag > 0).collect();
            let index: Vec<u32> = (0..len as u32).filter(|i| keep[*i as usize]).collect();
            let (mut by_host, mut by_device) = (map(&gpu, &host), map(&gpu, &host));
            by_host.retain(&keep).expect("fits");
            let flags: Vec<u32> = flags.into_iter().chain([1, 1]).collect();
            let flags = Buffer::from_slice(&gpu, "flags", &flags).expect("fits");
            by_device.retain_flagged(&flags).expect("fits");
            let wanted = pick(&host, &index);
            assert!(by_host.to_host().expect("reads") == wanted, "{len}, {share}");
            assert!(by_device.to_host().expect("reads") == wanted, "{len}, {share}");
            assert_eq!(by_host.read_means().expect("reads"), wanted.means);
        }
    }
    let mut map = map(&gpu, &support::scene(1, 10, CHANNELS, 0.05));
    let flags = Buffer::from_slice(&gpu, "flags", &[1u32; 9]).expect("fits");
    assert!(matches!(map.retain_flagged(&flags), Err(GpuError::ShapeMismatch { .. })));
    assert!(matches!(map.retain(&[true; 11]), Err(GpuError::ShapeMismatch { .. })));
    assert!(map.set_statistics(&[]).is_err());
}

fn targets(gpu: &Gpu, host: &HostGaussians) -> (Camera, ColorTarget, LanguageTarget) {
    let mut renderer = Renderer::new(gpu, CHANNELS).expect("compiles");
    let (map, camera) = (map(gpu, host), support::camera(48, 40));
    let image = renderer.render_color(&map, &camera).expect("renders");
    let rgb: Vec<u8> = image.rgb.iter().map(|v| (200.0 * v) as u8).collect();
    let codes = renderer.render_language(&map, &camera).expect("renders").codes;
    let color = ColorTarget::new(gpu, (48, 40), &rgb, &image.depth).expect("fits");
    let codes: Vec<f32> = codes.iter().map(|v| 0.8 * v).collect();
    (camera, color, LanguageTarget::new(gpu, 48, 40, CHANNELS, &codes).expect("fits"))
}

#[test]
fn training_goes_on_as_if_the_removed_had_never_been() {
    let gpu = support::gpu();
    let mut host = support::scene(13, 120, CHANNELS, 0.1);
    let (camera, color, language) = targets(&gpu, &host);
    let hidden = |i: usize| i % 4 == 1;
    for i in (0..120).filter(|i| hidden(*i)) {
        host.means[i] = camera.unproject(20.0, 20.0, -1.0 - i as f32).into();
    }
    let seen: Vec<u32> = (0..120).filter(|i| !hidden(*i as usize)).collect();
    let keep: Vec<bool> = (0..120).map(|i| !hidden(i)).collect();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let mut train = |map: &mut Gaussians| {
        let view = TrainingView {
            camera: &camera,
            color: Some(&color),
            language: Some((&camera, &language)),
            exposure: [0.0; 2],
        };
        let weights = LossWeights { isotropic: 0.0, tie: 0.0, ..LossWeights::default() };
        for _ in 0..4 {
            trainer.step(map, &view, &weights, &LearningRates::default()).expect("steps");
        }
    };
    let (mut whole, mut cut) = (map(&gpu, &host), map(&gpu, &host));
    train(&mut whole);
    train(&mut cut);
    let mut afresh = map(&gpu, &pick(&cut.to_host().expect("reads"), &seen));
    cut.retain(&keep).expect("fits");
    for map in [&mut whole, &mut cut, &mut afresh] {
        train(map);
    }
    let wanted = pick(&whole.to_host().expect("reads"), &seen);
    assert!(cut.to_host().expect("reads") == wanted, "bit for bit");
    assert!(afresh.to_host().expect("reads") != wanted, "lost moments would show");
}

#[test]
fn a_map_that_cannot_grow_is_as_it_was() {
    let gpu = support::gpu();
    let host = support::scene(15, 50, CHANNELS, 0.05);
    let mut map = map(&gpu, &host);
    map.set_statistics(&seen(15, 50)).expect("one each");
    let bytes = map.device_bytes();
    for len in [usize::MAX, usize::MAX >> 8, 1 << 30] {
        let error = map.reserve(len).expect_err("no device has that");
        assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
        assert_eq!(map.device_bytes(), bytes);
        assert!(map.to_host().expect("reads") == host);
        assert_eq!(map.statistics().expect("reads"), seen(15, 50));
    }
    map.append(&host).expect("and goes on");
    assert_eq!(map.len(), 100);
    assert_eq!(map.statistics().expect("reads")[50..], [Statistics::default(); 50]);
    map.clear_statistics();
    assert_eq!(map.statistics().expect("reads"), [Statistics::default(); 100]);
}

#[test]
fn language_codes_are_replaced_in_part() {
    let gpu = support::gpu();
    let mut host = support::scene(16, 40, CHANNELS, 0.05);
    let mut map = map(&gpu, &host);
    let codes: Vec<f32> = (0..3 * CHANNELS).map(|i| i as f32).collect();
    map.set_language_features_from(37, &codes).expect("they are there");
    host.language.features[37 * CHANNELS..].copy_from_slice(&codes);
    assert!(map.to_host().expect("reads") == host);
    for (start, len) in [(38, 3 * CHANNELS), (41, 0), (usize::MAX, CHANNELS), (0, 3)] {
        assert!(map.set_language_features_from(start, &codes[..len]).is_err(), "{start}, {len}");
    }
    assert!(map.to_host().expect("reads") == host);
}

#[test]
fn a_map_that_became_empty_can_do_everything() {
    let gpu = support::gpu();
    let host = support::scene(17, 30, CHANNELS, 0.05);
    let mut map = map(&gpu, &host);
    map.retain(&[false; 30]).expect("fits");
    map.retain(&[]).expect("nothing to do");
    map.retain_flagged(&Buffer::new(&gpu, "none", 0).expect("fits")).expect("nothing to do");
    map.reorder_morton().expect("nothing to do");
    assert_eq!(map.densify(&RULES).expect("nothing to do"), DensifyCounts::default());
    assert!(map.is_empty() && map.read_means().expect("reads").is_empty());
    assert!(map.statistics().expect("reads").is_empty());
    map.append(&host).expect("fits");
    assert!(map.to_host().expect("reads") == host);
    let all = DensifyRules { min_opacity: 1.0, ..RULES };
    let pruned = map.densify(&all).expect("fits");
    assert_eq!((pruned.pruned, pruned.len, map.len()), (30, 0, 0), "no opacity is 1");
}
