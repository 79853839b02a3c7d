//! Rendering against the oracle, and what must hold for any map: nothing hidden shows, poison does
//! no harm, the same twice.

use crate::support;

use crate::oracle::Head;
use crate::oracle::project::View;
use lexsplat_gpu::{Camera, Contribution, Gaussians, Gpu, GpuError, HostGaussians, Renderer};
use nalgebra::Point3;

/// Largest difference of a channel; measured worst case on llvmpipe: 6.1e-6, on SwiftShader: 1.0e-5
/// (depth, 300 small Gaussians). A pixel where alpha is within rounding of 1/255 may differ by that
/// much; the seeds have none.
const TOLERANCE: f64 = 2e-5;

fn map(gpu: &Gpu, scene: &HostGaussians) -> Gaussians {
    let mut gaussians = Gaussians::new(gpu, scene.language.channels);
    gaussians.append(scene).expect("fits");
    gaussians
}

/// Both pictures of a map as rows of all channels, with opacity last.
fn render(renderer: &mut Renderer, map: &Gaussians, camera: &Camera) -> [Vec<Vec<f32>>; 2] {
    let color = renderer.render_color(map, camera).expect("renders");
    let language = renderer.render_language(map, camera).expect("renders");
    let (channels, pixels) = (language.channels, camera.pixels());
    let rgb = |i: usize| color.rgb[3 * i..3 * i + 3].to_vec();
    let code = |i: usize| language.codes[channels * i..channels * (i + 1)].to_vec();
    [
        (0..pixels).map(|i| [rgb(i), vec![color.depth[i], color.opacity[i]]].concat()).collect(),
        (0..pixels).map(|i| [code(i), vec![language.opacity[i]]].concat()).collect(),
    ]
}

fn oracle(scene: &HostGaussians, camera: &Camera) -> [Vec<Vec<f64>>; 2] {
    let view = View::new(camera);
    [Head::color(scene), Head::language(scene)].map(|head| {
        let picture = head.render(&view);
        let rows = picture.image.chunks(head.picture_channels());
        rows.zip(&picture.transmittance).map(|(row, t)| [row, &[1.0 - t]].concat()).collect()
    })
}

fn difference(found: &[Vec<f32>], wanted: &[Vec<f64>]) -> f64 {
    assert_eq!(found.len(), wanted.len());
    let pairs = found.iter().flatten().zip(wanted.iter().flatten());
    pairs.map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

#[test]
fn pictures_match_the_oracle() {
    let gpu = support::gpu();
    for (seed, count, channels, size, (width, height)) in [
        (1, 1, 3, 0.2, (16, 16)),
        (2, 60, 15, 0.1, (67, 45)),
        (3, 300, 15, 0.03, (33, 64)),
        (4, 40, 1, 0.4, (50, 17)),
        (5, 30, 64, 0.15, (31, 31)),
        (6, 30, 16, 0.15, (5, 3)),
    ] {
        let mut renderer = Renderer::new(&gpu, channels).expect("compiles");
        let scene = support::scene(seed, count, channels, size);
        let camera = support::camera(width, height);
        let found = render(&mut renderer, &map(&gpu, &scene), &camera);
        let wanted = oracle(&scene, &camera);
        let mut other = scene.clone();
        other.means[0][0] += 0.01;
        other.language.opacity_logits[0] += 0.05;
        let control = oracle(&other, &camera);
        for head in 0..2 {
            let error = difference(&found[head], &wanted[head]);
            println!("seed {seed} head {head}: {error:.1e}");
            assert!(error < TOLERANCE, "seed {seed} head {head}: {error:.1e}");
            let control = difference(&found[head], &control[head]);
            assert!(control > TOLERANCE, "seed {seed}: a moved gaussian must show: {control:.1e}");
        }
    }
}

#[test]
fn an_overflow_grows_the_lists_and_gives_the_same_picture() {
    let gpu = support::gpu();
    let scene = support::scene(7, 200, 15, 0.2);
    let camera = support::camera(67, 45);
    let map = map(&gpu, &scene);
    let wanted = render(&mut Renderer::new(&gpu, 15).expect("compiles"), &map, &camera);
    let mut small = Renderer::with_hit_capacity(&gpu, 15, 7).expect("compiles");
    assert_eq!(render(&mut small, &map, &camera), wanted, "bit for bit");
    assert!(difference(&wanted[0], &oracle(&scene, &camera)[0]) < TOLERANCE);
}

#[test]
fn the_same_twice_and_after_another_view() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let map = map(&gpu, &support::scene(8, 200, 15, 0.1));
    let camera = support::camera(67, 45);
    let first = render(&mut renderer, &map, &camera);
    render(&mut renderer, &map, &support::camera(90, 70));
    assert_eq!(render(&mut renderer, &map, &camera), first, "bit for bit");
}

#[test]
fn an_empty_map_gives_the_background() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(20, 10);
    let mut gaussians = Gaussians::new(&gpu, 15);
    let dark =
        |pictures: &[Vec<Vec<f32>>; 2]| pictures.iter().flatten().flatten().all(|v| *v == 0.0);
    assert!(dark(&render(&mut renderer, &gaussians, &camera)));
    assert!(renderer.contributions(&gaussians, &camera).expect("reads").is_empty());
    gaussians.append(&support::scene(1, 5, 15, 0.2)).expect("fits");
    assert!(!dark(&render(&mut renderer, &gaussians, &camera)));
    assert_eq!(gaussians.prune(1.0).expect("fits"), 5, "no opacity is 1");
    assert!(gaussians.is_empty() && dark(&render(&mut renderer, &gaussians, &camera)));
}

#[test]
fn hidden_gaussians_change_nothing() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(67, 45);
    let scene = support::scene(9, 100, 15, 0.1);
    let mut shown = map(&gpu, &scene);
    let wanted = render(&mut renderer, &shown, &camera);
    let mut hidden = support::scene(10, 3, 15, 0.1);
    hidden.means[0] = camera.unproject(30.0, 20.0, -2.0).into();
    hidden.means[1] = camera.unproject(30.0, 20.0, 0.05).into();
    for head in [&mut hidden.color, &mut hidden.language] {
        head.opacity_logits[2] = -6.0;
    }
    shown.append(&hidden).expect("fits");
    assert_eq!(render(&mut renderer, &shown, &camera), wanted, "bit for bit");
    let given = renderer.contributions(&shown, &camera).expect("reads");
    assert!(given[100..].iter().all(|given| *given == Contribution::default()));
    let mut open = support::scene(10, 1, 15, 0.1);
    open.means[0] = camera.unproject(30.0, 20.0, 1.0).into();
    shown.append(&open).expect("fits");
    assert_ne!(render(&mut renderer, &shown, &camera), wanted, "a shown one does");
}

#[test]
fn poisoned_gaussians_are_left_out() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(67, 45);
    let scene = support::scene(11, 60, 15, 0.1);
    let mut gaussians = map(&gpu, &scene);
    let wanted = render(&mut renderer, &gaussians, &camera);
    let mut bad = support::scene(12, 0, 15, 0.1);
    for poison in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for place in 0..4 {
            let mut one = support::scene(12, 1, 15, 0.1);
            one.means[0] = camera.unproject(30.0, 20.0, 1.0).into();
            for head in [&mut one.color, &mut one.language] {
                match place {
                    0 => one.means[0][0] = poison,
                    1 => head.rotations[0] = [poison, 0.0, 0.0, 1.0],
                    2 => head.log_scales[0][1] = poison,
                    _ => head.opacity_logits[0] = if poison > 0.0 { -poison } else { poison },
                }
            }
            extend(&mut bad, &one);
        }
    }
    let mut zero = support::scene(12, 2, 15, 0.1);
    for head in [&mut zero.color, &mut zero.language] {
        head.rotations[0] = [0.0; 4];
        head.opacity_logits[1] = -1e9;
    }
    extend(&mut bad, &zero);
    gaussians.append(&bad).expect("fits");
    assert_eq!(render(&mut renderer, &gaussians, &camera), wanted, "bit for bit");
}

fn extend(all: &mut HostGaussians, more: &HostGaussians) {
    all.means.extend(&more.means);
    for (all, more) in [(&mut all.color, &more.color), (&mut all.language, &more.language)] {
        all.rotations.extend(&more.rotations);
        all.log_scales.extend(&more.log_scales);
        all.opacity_logits.extend(&more.opacity_logits);
        all.features.extend(&more.features);
    }
}

#[test]
fn extreme_gaussians_give_finite_pictures() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(67, 45);
    let mut scene = support::scene(13, 3000, 15, 0.1);
    for i in 0..3000 {
        // Thousands on one pixel, of every size and opacity.
        scene.means[i] = camera.unproject(30.2, 20.1, 0.2 + 1e-3 * (i % 7) as f32).into();
        for head in [&mut scene.color, &mut scene.language] {
            let extremes = [-1e9, -80.0, -8.0, 3.0, 18.0, 40.0, 1e9];
            head.log_scales[i] = [extremes[i % 7], extremes[i / 7 % 7], extremes[i / 49 % 7]];
            head.opacity_logits[i] = if i % 3 == 0 { 1e9 } else { -2.0 };
        }
    }
    let pictures = render(&mut renderer, &map(&gpu, &scene), &camera);
    assert!(pictures.iter().flatten().flatten().all(|value| value.is_finite()));
    let centre = 20 * 67 + 30;
    let opacity = *pictures[0][centre].last().expect("opacity");
    assert!(opacity > 0.99 && opacity <= 1.0, "{opacity}");
}

#[test]
fn thousands_on_one_pixel_match_the_oracle() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(33, 20);
    let mut scene = support::scene(14, 2000, 15, 0.05);
    for i in 0..2000 {
        scene.means[i] = camera.unproject(16.0, 10.0, 1.0 + 1e-3 * i as f32).into();
        scene.color.opacity_logits[i] = -5.0;
        scene.language.opacity_logits[i] = -5.2;
    }
    let found = render(&mut renderer, &map(&gpu, &scene), &camera);
    let wanted = oracle(&scene, &camera);
    for head in 0..2 {
        // Measured on llvmpipe: 3.0e-6.
        let error = difference(&found[head], &wanted[head]);
        println!("crowd head {head}: {error:.1e}");
        assert!(error < TOLERANCE, "head {head}: {error:.1e}");
    }
}

/// Sums over up to 1,000 pixels, where a rounding is 6e-5, and five of them 3e-4. Measured on llvmpipe:
/// 5.1e-5, on SwiftShader: 8.4e-5.
#[test]
fn contributions_match_the_image() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(67, 45);
    let scene = support::scene(15, 300, 15, 0.1);
    let found = renderer.contributions(&map(&gpu, &scene), &camera).expect("reads");
    let wanted = Head::color(&scene).render(&View::new(&camera));
    let worst = |factor: f64| {
        let pairs = found.iter().zip(&wanted.weights);
        pairs.map(|(a, b)| (f64::from(a.weight) - factor * b).abs()).fold(0.0, f64::max)
    };
    println!("weights: {:.1e}", worst(1.0));
    assert!(worst(1.0) < 3e-4, "{:.1e}", worst(1.0));
    assert!(worst(1.001) > 3e-4, "a per mille must show");
    let touched: Vec<f32> = found.iter().map(|given| given.touched_pixels).collect();
    assert_eq!(touched, wanted.touched, "pixels");
    assert!(touched.iter().any(|n| *n > 10.0) && touched.contains(&0.0), "both kinds");
}

#[test]
fn a_point_lands_on_the_pixel_that_the_camera_says() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(67, 45);
    let mut scene = support::scene(16, 1, 15, 0.01);
    scene.means[0] = camera.unproject(40.0, 12.0, 2.0).into();
    scene.color.opacity_logits[0] = 1.0;
    let image = renderer.render_color(&map(&gpu, &scene), &camera).expect("renders");
    let brightest =
        (0..image.opacity.len()).max_by(|a, b| image.opacity[*a].total_cmp(&image.opacity[*b]));
    assert_eq!(brightest, Some(12 * 67 + 40));
    let depth = image.depth[12 * 67 + 40] / image.opacity[12 * 67 + 40];
    assert!((depth - 2.0).abs() < 1e-4, "{depth}");
    let (u, v, _) = camera.project(&Point3::from(scene.means[0])).expect("in front");
    assert!((u - 40.0).abs() < 1e-3 && (v - 12.0).abs() < 1e-3);
}

#[test]
fn appending_and_dropping_keep_the_others() {
    let gpu = support::gpu();
    let scene = support::scene(17, 2500, 15, 0.1);
    let mut dropped = support::scene(18, 10, 15, 0.1);
    dropped.color.opacity_logits = vec![-9.0; 10];
    dropped.language.opacity_logits = vec![-9.0; 10];
    let mut gaussians = map(&gpu, &dropped);
    gaussians.append(&scene).expect("fits");
    assert_eq!(gaussians.prune(0.001).expect("fits"), 10);
    assert_eq!(gaussians.to_host().expect("reads"), scene);
    let codes = vec![0.25; 2500 * 15];
    gaussians.set_language_features(&codes).expect("fits");
    let host = gaussians.to_host().expect("reads");
    assert_eq!(host.language.features, codes);
    assert_eq!(host.color, scene.color);
    assert!(gaussians.device_bytes() > 2500 * 4 * (4 + 8 + 4 + 8 + 16));
}

#[test]
fn wrong_shapes_are_refused_by_name() {
    let gpu = support::gpu();
    let mut scene = support::scene(19, 4, 15, 0.1);
    scene.language.log_scales.pop();
    let mut gaussians = Gaussians::new(&gpu, 15);
    let error = gaussians.append(&scene).expect_err("a scale is missing");
    assert_eq!(error.to_string(), "log_scales: expected 4, found 3");
    assert!(gaussians.is_empty());
    let mut renderer = Renderer::new(&gpu, 8).expect("compiles");
    let camera = support::camera(20, 10);
    let other = renderer.render_color(&gaussians, &camera);
    assert!(matches!(other, Err(GpuError::ShapeMismatch { what: "language_channels", .. })));
    let flat = Camera { fx: 0.0, ..camera };
    let gaussians = Gaussians::new(&gpu, 8);
    assert!(matches!(renderer.render_color(&gaussians, &flat), Err(GpuError::BadValue { .. })));
    assert!(matches!(Renderer::new(&gpu, 65), Err(GpuError::BadValue { .. })));
    let missing = Gpu::new(Some("no such adapter")).err().expect("it is not there");
    assert!(missing.to_string().contains("mesa-vulkan-drivers"), "{missing}");
}

#[test]
fn everything_may_move_to_another_thread() {
    fn send<T: Send>() {}
    send::<Gpu>();
    send::<Gaussians>();
    send::<Renderer>();
}

/// One Gaussian over a picture of very many tiles: no loop of a kernel ends early. The software
/// adapter refuses what it cannot walk over.
#[test]
fn a_gaussian_may_cover_every_tile() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 3).expect("compiles");
    let mut scene = support::scene(20, 1, 3, 0.1);
    let camera = Camera {
        camera_from_world: nalgebra::Isometry3::identity(),
        ..support::camera(2048, 1536)
    };
    scene.means[0] = camera.unproject(1000.0, 800.0, 2.0).into();
    scene.color.log_scales[0] = [4.0; 3];
    scene.color.opacity_logits[0] = 0.0;
    let image = renderer.render_color(&map(&gpu, &scene), &camera).expect("renders");
    let least = image.opacity.iter().copied().fold(1.0, f32::min);
    assert!(least > 0.49, "opaque all over: {least}");
    let huge = Camera { width: 4096, height: 2160, ..camera };
    match renderer.render_color(&map(&gpu, &scene), &huge) {
        Ok(image) => assert!(image.opacity.iter().all(|opacity| *opacity > 0.4)),
        Err(error) => assert!(matches!(error, GpuError::Limit { .. }), "{error}"),
    }
}
