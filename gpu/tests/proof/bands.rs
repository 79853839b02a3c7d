//! Bands of tiles: what does not fit into one list is listed, blended and taken back part by part,
//! to the same bits.

use crate::support;
use crate::training::{DATA, Targets, disturbed, map, train};

use lexsplat_gpu::{
    ColorTarget, Gpu, GpuError, HeadGradient, HostGaussians, LanguageTarget, LearningRates,
    Renderer, Trainer, TrainingView,
};
use std::time::Instant;

const CHANNELS: usize = 15;

/// Pictures, contributions and gradients of a scene from lists of at most `most` hits.
fn results(gpu: &Gpu, scene: &HostGaussians, most: usize) -> (Vec<Vec<f32>>, [HeadGradient; 2]) {
    let camera = support::camera(67, 45);
    let map = map(gpu, scene);
    let mut renderer = Renderer::new(gpu, CHANNELS).expect("compiles");
    renderer.limit_lists(most);
    let color = renderer.render_color(&map, &camera).expect("renders");
    let given = renderer.contributions(&map, &camera).expect("renders");
    let workload = renderer.workload(&map, &camera).expect("counts");
    let codes = renderer.render_language(&map, &camera).expect("renders");
    let ramp = |i: usize| (i % 17) as f32 / 17.0 - 0.4;
    let rows: Vec<[f32; 4]> =
        (0..camera.pixels()).map(|i| std::array::from_fn(|k| ramp(4 * i + k))).collect();
    let d_codes: Vec<f32> = (0..camera.pixels() * CHANNELS).map(ramp).collect();
    let gradients = [
        renderer.color_gradients(&map, &camera, &rows).expect("runs"),
        renderer.language_gradients(&map, &camera, &d_codes).expect("runs"),
    ];
    let again = renderer.render_color(&map, &camera).expect("renders");
    assert_eq!(again, color, "with the bands that records need, too");
    let counts = [workload.visible, workload.hits, workload.evaluations as usize];
    let pictures = vec![
        color.rgb,
        color.depth,
        color.opacity,
        codes.codes,
        codes.opacity,
        given.iter().flat_map(|given| [given.weight, given.touched_pixels]).collect(),
        counts.map(|count| count as f32).to_vec(),
    ];
    (pictures, gradients)
}

#[test]
fn bands_change_no_bit_of_pictures_and_gradients() {
    // The two make lists in two ways (on llvmpipe).
    for gpu in [support::gpu(), support::gpu_of_tier("portable")] {
        same_pictures_and_gradients(&gpu);
    }
}

fn same_pictures_and_gradients(gpu: &Gpu) {
    let mut scene = support::scene(92, 400, CHANNELS, 0.15);
    // Over many tiles of many bands, and beyond the border.
    scene.color.log_scales[0] = [0.0, -3.0, -1.0];
    scene.language.log_scales[1] = [0.5, -2.0, -2.0];
    let wanted = results(gpu, &scene, usize::MAX);
    // Too few for one list of all hits of the picture.
    let most = (0.7 * wanted.0[6][1]) as usize;
    assert!(most > 1000, "{most} hits");
    assert_eq!(results(gpu, &scene, most), wanted, "bit for bit");
    let other = results(gpu, &support::scene(93, 400, CHANNELS, 0.15), most);
    assert!(other.0 != wanted.0 && other.1 != wanted.1, "another scene must show");
}

#[test]
fn bands_change_no_bit_of_steps() {
    let gpu = support::gpu();
    let scene = support::scene(94, 150, CHANNELS, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let run = |most| {
        let mut trainer = Trainer::with_hit_capacity(&gpu, CHANNELS, 100).expect("compiles");
        trainer.renderer().limit_lists(most);
        let mut map = map(&gpu, &disturbed(&scene));
        let losses = train(&mut trainer, &mut map, &targets.view(true, true), 4);
        (losses, map.to_host().expect("reads"), trainer.hit_capacities())
    };
    let wanted = run(usize::MAX);
    let most = 1500;
    let found = run(most);
    assert!(found.2[0] > 2 * most, "{:?} hits must take several bands", found.2);
    assert_eq!((&found.0, &found.1), (&wanted.0, &wanted.1), "bit for bit");
    assert_ne!(found.1, disturbed(&scene), "the steps moved something");
}

#[test]
fn a_row_of_tiles_that_no_list_can_hold_is_refused() {
    let gpu = support::gpu();
    let scene = support::scene(95, 150, CHANNELS, 0.3);
    let map = map(&gpu, &scene);
    let camera = support::camera(67, 45);
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let wanted = renderer.render_color(&map, &camera).expect("renders");
    renderer.limit_lists(20);
    let error = renderer.render_color(&map, &camera).expect_err("too many");
    assert!(matches!(error, GpuError::Limit { .. }), "{error}");
    renderer.limit_lists(usize::MAX);
    assert_eq!(renderer.render_color(&map, &camera).expect("renders"), wanted, "as before");
}

/// A picture of more tiles than a loop may visit (on llvmpipe), under one Gaussian over all of them.
#[test]
fn a_gaussian_covers_a_picture_of_4k() {
    let gpu = support::gpu();
    let mut scene = support::scene(96, 3, CHANNELS, 0.1);
    scene.means[0] = [0.0, 0.0, 3.0];
    scene.color.log_scales[0] = [4.0; 3];
    scene.color.opacity_logits[0] = 1.0;
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let image = renderer.render_color(&map(&gpu, &scene), &support::camera(3840, 2160));
    let image = image.expect("renders");
    let least = image.opacity.iter().copied().fold(f32::INFINITY, f32::min);
    assert!(least > 0.7, "every pixel is covered: {least}");
}

/// `cargo test -p lexsplat-gpu bands -- --ignored --nocapture`
#[test]
#[ignore = "minutes and gigabytes: make bench"]
fn two_million_gaussians_are_drawn_at_4k_and_trained() {
    let gpu = support::gpu();
    let map = map(&gpu, &support::scene(91, 2_000_000, 15, 0.002));
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    for (width, height) in [(1200, 680), (1920, 1080), (3840, 2160)] {
        let start = Instant::now();
        let drawn = renderer.render_color(&map, &support::camera(width, height)).map(|_| ());
        let bytes = renderer.device_bytes() >> 20;
        println!("{width}x{height}: {drawn:?} {:.1?}, {bytes} MiB", start.elapsed());
    }
    drop(renderer);
    let mut map = map;
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(1200, 680);
    let labels = support::camera(600, 340);
    let color = ColorTarget::new(&gpu, 1200, 680, &vec![9; 3 * 816_000], &vec![2.0; 816_000])
        .expect("fits");
    let language = LanguageTarget::new(&gpu, 600, 340, 15, &vec![0.5; 15 * 204_000]).expect("fits");
    for language in [None, Some((&labels, &language))] {
        let view = TrainingView {
            camera: &camera,
            color: Some(&color),
            language,
            exposure: [0.0; 2],
            focus: None,
        };
        let start = Instant::now();
        let taken = trainer.step(&mut map, &view, &DATA, &LearningRates::default());
        let taken = taken.and_then(|()| trainer.last_report(&mut map));
        println!("step: {taken:?} {:.1?}", start.elapsed());
    }
}
