//! Removing Gaussians, growing, and writing parts of a map.

use super::{CHANNELS, LENGTHS, MIN_OPACITY, map, mark, pick};
use crate::support;

use lexsplat_gpu::{
    Buffer, Camera, ColorTarget, Gaussians, Gpu, GpuError, HostGaussians, LanguageTarget,
    LearningRates, LossWeights, Renderer, SavedGaussians, Trainer, TrainingView,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn pruning_is_a_filter() {
    let gpu = support::gpu();
    for len in LENGTHS {
        let host = support::scene(len as u64, len, CHANNELS, 0.05);
        let mut rng = ChaCha8Rng::seed_from_u64(len as u64);
        for share in [0.0, 0.5, 0.9, 1.0] {
            let keep: Vec<bool> = (0..len).map(|_| rng.random_bool(share)).collect();
            let index: Vec<u32> = (0..len as u32).filter(|i| keep[*i as usize]).collect();
            let host = mark(&host, &keep);
            let mut map = map(&gpu, &host);
            assert_eq!(map.prune(MIN_OPACITY).expect("fits"), len - index.len());
            let wanted = pick(&host, &index);
            assert!(map.to_host().expect("reads") == wanted, "{len}, {share}");
            assert_eq!(map.read_means().expect("reads"), wanted.means);
        }
    }
}

fn targets(gpu: &Gpu, host: &HostGaussians) -> (Camera, ColorTarget, LanguageTarget) {
    let mut renderer = Renderer::new(gpu, CHANNELS).expect("compiles");
    let (map, camera) = (map(gpu, host), support::camera(48, 40));
    let image = renderer.render_color(&map, &camera).expect("renders");
    let rgb: Vec<u8> = image.rgb.iter().map(|v| (200.0 * v) as u8).collect();
    let codes = renderer.render_language(&map, &camera).expect("renders").codes;
    let color = ColorTarget::new(gpu, 48, 40, &rgb, &image.depth).expect("fits");
    let codes: Vec<f32> = codes.iter().map(|v| 0.8 * v).collect();
    (camera, color, LanguageTarget::new(gpu, 48, 40, CHANNELS, &codes).expect("fits"))
}

#[test]
fn removing_unseen_gaussians_does_not_change_training() {
    let gpu = support::gpu();
    let mut host = support::scene(13, 120, CHANNELS, 0.1);
    let (camera, color, language) = targets(&gpu, &host);
    let hidden = |i: usize| i % 4 == 1;
    // Behind the camera and transparent: no step moves them, and pruning removes them.
    for i in (0..120).filter(|i| hidden(*i)) {
        host.means[i] = camera.unproject(20.0, 20.0, -1.0 - i as f32).into();
        (host.color.opacity_logits[i], host.language.opacity_logits[i]) = (-9.0, -9.0);
    }
    let seen: Vec<u32> = (0..120).filter(|i| !hidden(*i as usize)).collect();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let mut train = |map: &mut Gaussians| {
        let view = TrainingView {
            camera: &camera,
            color: Some(&color),
            language: Some((&camera, &language)),
            exposure: [0.0; 2],
            focus: None,
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
    assert_eq!(cut.prune(0.001).expect("fits"), 30, "the hidden ones");
    for map in [&mut whole, &mut cut, &mut afresh] {
        train(map);
    }
    let wanted = pick(&whole.to_host().expect("reads"), &seen);
    assert!(cut.to_host().expect("reads") == wanted, "bit for bit");
    assert!(afresh.to_host().expect("reads") != wanted, "lost moments would show");
}

#[test]
fn a_saved_map_goes_on_like_the_original() {
    let gpu = support::gpu();
    let host = support::scene(14, 90, CHANNELS, 0.1);
    let (camera, color, language) = targets(&gpu, &host);
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let mut train = |map: &mut Gaussians| {
        let (color, language) = (Some(&color), Some((&camera, &language)));
        let view =
            TrainingView { camera: &camera, color, language, exposure: [0.0; 2], focus: None };
        for _ in 0..4 {
            let (weights, rates) = (LossWeights::default(), LearningRates::default());
            trainer.step(map, &view, &weights, &rates).expect("steps");
        }
        trainer.settle(map).expect("settles");
    };
    let mut original = map(&gpu, &host);
    original.set_owner(7).expect("a small number");
    train(&mut original);
    let saved = SavedGaussians::of(&original).expect("reads");
    let mut copy = saved.upload(&gpu).expect("fits");
    assert_eq!(SavedGaussians::of(&copy).expect("reads"), saved);
    let mut afresh = map(&gpu, &original.to_host().expect("reads"));
    for map in [&mut original, &mut copy, &mut afresh] {
        train(map);
    }
    let wanted = original.to_host().expect("reads");
    assert!(copy.to_host().expect("reads") == wanted, "bit for bit");
    assert!(afresh.to_host().expect("reads") != wanted, "lost moments would show");
    let empty = SavedGaussians::of(&Gaussians::new(&gpu, CHANNELS)).expect("nothing to read");
    assert!(empty.upload(&gpu).expect("nothing to write").is_empty());
    for wrong in [
        SavedGaussians { len: saved.len - 1, ..saved.clone() },
        SavedGaussians { channels: 0, ..saved.clone() },
        SavedGaussians { bytes: Vec::new(), ..saved },
    ] {
        assert!(wrong.upload(&gpu).is_err(), "{}", wrong.len);
    }
}

#[test]
fn a_map_that_cannot_grow_is_as_it_was() {
    let gpu = support::gpu();
    let host = support::scene(15, 50, CHANNELS, 0.05);
    let mut map = map(&gpu, &host);
    let bytes = map.device_bytes();
    for len in [usize::MAX, usize::MAX >> 8, 1 << 30] {
        let error = map.reserve(len).expect_err("no device has that");
        assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
        assert_eq!(map.device_bytes(), bytes);
        assert!(map.to_host().expect("reads") == host);
    }
    map.append(&host).expect("and goes on");
    assert_eq!(map.len(), 100);
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
    assert_eq!(map.prune(1.0).expect("fits"), 30, "no opacity is 1");
    assert_eq!(map.prune(1.0).expect("nothing to do"), 0);
    map.reorder_morton().expect("nothing to do");
    assert!(map.is_empty() && map.read_means().expect("reads").is_empty());
    map.append(&host).expect("fits");
    assert!(map.to_host().expect("reads") == host);
}

#[test]
fn a_map_for_drawing_draws_the_same_in_a_third_of_the_memory() {
    let gpu = support::gpu();
    let host = support::scene(18, 5000, CHANNELS, 0.05);
    let trainable = map(&gpu, &host);
    let mut drawn = Gaussians::for_drawing(&gpu, CHANNELS);
    for part in [0..2500, 2500..5000] {
        drawn.append(&pick(&host, &part.collect::<Vec<u32>>())).expect("grows");
    }
    assert!(drawn.to_host().expect("reads") == host);
    let bytes = [&drawn, &trainable].map(Gaussians::device_bytes);
    // The capacity of a map that grows may be half as much again.
    assert!(2 * bytes[0] < bytes[1], "{bytes:?}");
    let camera = support::camera(67, 45);
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let mut picture = |map| renderer.render_color(map, &camera).expect("renders").rgb;
    assert!(picture(&drawn) == picture(&trainable), "bit for bit");
    let (camera, color, _) = targets(&gpu, &host);
    let view = TrainingView {
        camera: &camera,
        color: Some(&color),
        language: None,
        exposure: [0.0; 2],
        focus: None,
    };
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let (weights, rates) = (LossWeights::default(), LearningRates::default());
    assert!(trainer.step(&mut drawn, &view, &weights, &rates).is_err(), "it has no moments");
}

#[test]
fn a_large_map_is_read_back_in_pieces() {
    let gpu = support::gpu();
    let host = support::scene(19, 150_000, CHANNELS, 0.01);
    let map = map(&gpu, &host);
    assert!(map.to_host().expect("reads") == host);
    let saved = SavedGaussians::of(&map).expect("reads");
    let again = saved.upload(&gpu).expect("fits");
    assert!(again.to_host().expect("reads") == host);
    let mut sizes = Vec::new();
    let values: Vec<u32> = (0..1000).collect();
    let buffer = Buffer::from_slice(&gpu, "values", &values).expect("fits");
    let mut read = Vec::new();
    let take = |some: &[u32]| {
        sizes.push(some.len());
        read.extend_from_slice(some);
    };
    buffer.read_some(&gpu, 999, 300, take).expect("reads");
    assert_eq!((read.as_slice(), sizes), (&values[..999], vec![300, 300, 300, 99]));
}
