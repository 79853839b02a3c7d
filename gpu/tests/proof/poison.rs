//! Values that no map should have: they harm neither the picture, nor the other Gaussians, nor
//! their gradients, nor what a step makes of them.

use crate::support;

use crate::oracle::Head;
use crate::oracle::project::{self, View};
use lexsplat_gpu::shader::layout::{HUGE, NEAR};
use lexsplat_gpu::{
    Camera, ColorTarget, Gaussians, Gpu, HeadGradient, HostGaussians, LanguageTarget,
    LearningRates, LossWeights, Renderer, Trainer, TrainingView,
};
use nalgebra::Isometry3;

const CHANNELS: usize = 6;
/// Largest difference of a picture from the oracle's, as in forward.rs.
const TOLERANCE: f64 = 2e-5;

fn map(gpu: &Gpu, scene: &HostGaussians) -> Gaussians {
    let mut gaussians = Gaussians::new(gpu, CHANNELS);
    gaussians.append(scene).expect("fits");
    gaussians
}

/// A camera at the world's origin: z in the camera is z in the world, to the last bit.
fn straight(width: u32, height: u32) -> Camera {
    Camera { camera_from_world: Isometry3::identity(), ..support::camera(width, height) }
}

/// All channels of both pictures and both opacities.
fn pictures(renderer: &mut Renderer, map: &Gaussians, camera: &Camera) -> Vec<f32> {
    let color = renderer.render_color(map, camera).expect("renders");
    let language = renderer.render_language(map, camera).expect("renders");
    [color.rgb, color.depth, color.opacity, language.codes, language.opacity].concat()
}

/// Gradients of both heads for a fixed function of the pictures.
fn gradients(renderer: &mut Renderer, map: &Gaussians, camera: &Camera) -> [HeadGradient; 2] {
    let ramp = |i: usize| (i % 23) as f32 / 23.0 - 0.4;
    let rows: Vec<[f32; 4]> =
        (0..camera.pixels()).map(|i| std::array::from_fn(|k| ramp(4 * i + k))).collect();
    let codes: Vec<f32> = (0..camera.pixels() * CHANNELS).map(ramp).collect();
    [
        renderer.color_gradients(map, camera, &rows).expect("runs"),
        renderer.language_gradients(map, camera, &codes).expect("runs"),
    ]
}

/// All gradients of Gaussian `i`.
fn row(gradient: &HeadGradient, i: usize) -> Vec<f32> {
    let head = &gradient.head;
    let channels = head.channels;
    let mean = gradient.means.get(i).map_or(&[][..], |mean| mean);
    [
        mean,
        &head.rotations[i],
        &head.log_scales[i],
        &head.opacity_logits[i..=i],
        &head.features[channels * i..channels * (i + 1)],
    ]
    .concat()
}

/// One step towards grey pictures and codes.
fn step(gpu: &Gpu, trainer: &mut Trainer, map: &mut Gaussians, camera: &Camera) {
    let (pixels, size) = (camera.pixels(), (camera.width, camera.height));
    let color = ColorTarget::new(gpu, size.0, size.1, &vec![128; 3 * pixels], &vec![1.0; pixels]);
    let codes = vec![0.5; CHANNELS * pixels];
    let language = LanguageTarget::new(gpu, size.0, size.1, CHANNELS, &codes).expect("fits");
    let color = color.expect("fits");
    let view = TrainingView {
        camera,
        color: Some(&color),
        language: Some((camera, &language)),
        exposure: [0.0; 2],
        focus: None,
    };
    trainer.step(map, &view, &LossWeights::default(), &LearningRates::default()).expect("steps");
    trainer.settle(map).expect("settles");
}

/// What is wrong, and how to make it so.
type Poison = (String, Box<dyn Fn(&mut HostGaussians)>);

/// Every way to spoil one parameter of Gaussian 0 so that it cannot be drawn.
fn poisons() -> Vec<Poison> {
    let mut all: Vec<Poison> = Vec::new();
    for poison in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN] {
        for axis in 0..3 {
            all.push((
                format!("mean {axis} {poison}"),
                Box::new(move |s| s.means[0][axis] = poison),
            ));
            all.push((
                format!("log scale {axis} {poison}"),
                Box::new(move |s| {
                    s.color.log_scales[0][axis] = poison;
                    s.language.log_scales[0][axis] = poison;
                }),
            ));
        }
        for part in 0..4 {
            all.push((
                format!("rotation {part} {poison}"),
                Box::new(move |s| {
                    s.color.rotations[0][part] = poison;
                    s.language.rotations[0][part] = poison;
                }),
            ));
        }
    }
    for logit in [f32::NAN, f32::NEG_INFINITY, f32::MIN, -100.0] {
        all.push((
            format!("opacity logit {logit}"),
            Box::new(move |s| {
                s.color.opacity_logits[0] = logit;
                s.language.opacity_logits[0] = logit;
            }),
        ));
    }
    for length in [0.0, -0.0, 1e-40, 1e-20, 1e20] {
        all.push((
            format!("quaternion of length {length}"),
            Box::new(move |s| {
                s.color.rotations[0] = [length, 0.0, -length, length];
                s.language.rotations[0] = [length, 0.0, -length, length];
            }),
        ));
    }
    for z in [-3.0, -NEAR, -1e-30, -0.0, 0.0, 1e-30, NEAR / 2.0, NEAR, 1e6, 1e20] {
        all.push((format!("z {z}"), Box::new(move |s| s.means[0] = [0.01, 0.01, z])));
    }
    all
}

#[test]
fn a_gaussian_with_bad_values_is_not_drawn_and_changes_no_other() {
    let gpu = support::gpu();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let camera = straight(37, 29);
    let mut sound = support::scene(41, 40, CHANNELS, 0.1);
    sound.means[0] = [0.0, 0.0, 0.9];
    let mut alone = map(&gpu, &sound);
    let with = pictures(trainer.renderer(), &alone, &camera);
    alone = map(&gpu, &support::pick(&sound, &(1..40).collect::<Vec<_>>()));
    let wanted = pictures(trainer.renderer(), &alone, &camera);
    assert_ne!(with, wanted, "unspoilt, it shows");
    let wanted_gradients = gradients(trainer.renderer(), &alone, &camera);
    step(&gpu, &mut trainer, &mut alone, &camera);
    let moved = alone.to_host().expect("reads");
    for (name, spoil) in poisons() {
        let mut scene = sound.clone();
        spoil(&mut scene);
        let mut spoilt = map(&gpu, &scene);
        assert!(pictures(trainer.renderer(), &spoilt, &camera) == wanted, "{name}: bit for bit");
        for (found, wanted) in
            gradients(trainer.renderer(), &spoilt, &camera).iter().zip(&wanted_gradients)
        {
            assert!(row(found, 0).iter().all(|g| *g == 0.0), "{name}: {:?}", row(found, 0));
            for i in 1..40 {
                assert!(row(found, i) == row(wanted, i - 1), "{name}: gaussian {i}, bit for bit");
            }
        }
        step(&gpu, &mut trainer, &mut spoilt, &camera);
        let after = spoilt.to_host().expect("reads");
        assert_eq!(bits(&after, 0..1), bits(&scene, 0..1), "{name}: it stays as it was");
        assert!(bits(&after, 1..40) != bits(&scene, 1..40), "{name}: the others learn");
        // The shape losses are means over all Gaussians, so the others' steps differ a little.
        let close = after.means[1..].iter().flatten().zip(moved.means.iter().flatten());
        let apart = close.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-6, "{name}: the others move as without it: {apart:.1e}");
    }
}

/// Every parameter of some Gaussians, as bits.
fn bits(scene: &HostGaussians, which: std::ops::Range<usize>) -> Vec<u32> {
    let mut all: Vec<f32> = scene.means[which.clone()].concat();
    for head in [&scene.color, &scene.language] {
        all.extend(head.rotations[which.clone()].iter().flatten());
        all.extend(head.log_scales[which.clone()].iter().flatten());
        all.extend(&head.opacity_logits[which.clone()]);
        all.extend(&head.features[head.channels * which.start..head.channels * which.end]);
    }
    all.iter().map(|value| value.to_bits()).collect()
}

/// Scales of 1e-20 and 1e20 metres, opacities of 0 and 1: drawn as the oracle draws them, up to a
/// covariance in the image whose determinant no longer fits.
#[test]
fn extreme_values_are_clamped_and_drawn() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = straight(37, 29);
    for log_scales in [
        [-46.0, -46.0, -46.0],
        [46.0, 46.0, 46.0],
        [-46.0, -3.0, 6.0],
        [-1e29, -3.0, -2.0],
        [-2.0, -1.0, -46.0],
    ] {
        for logit in [-100.0, -6.0, 0.3, 100.0, f32::MAX, f32::INFINITY] {
            let mut scene = support::scene(42, 3, CHANNELS, 0.1);
            scene.means[0] = [0.1, -0.05, 0.8];
            for head in [&mut scene.color, &mut scene.language] {
                head.log_scales[0] = log_scales;
                head.opacity_logits[0] = logit;
            }
            let map = map(&gpu, &scene);
            let image = renderer.render_color(&map, &camera).expect("renders");
            let view = View::new(&camera);
            let mut head = Head::color(&scene);
            let splat = project::forward(&view, &head.shapes[0]);
            if splat.is_some_and(|splat| 1.0 / splat.conic.determinant() >= f64::from(HUGE)) {
                head.shapes[0].mean.z = -1.0; // too large to be drawn
            }
            let wanted = head.render(&view).transmittance;
            let pairs = image.opacity.iter().zip(&wanted);
            let error = pairs.map(|(a, t)| (f64::from(*a) - (1.0 - t)).abs()).fold(0.0, f64::max);
            let name = format!("log scales {log_scales:?} logit {logit}");
            // Measured on llvmpipe: 1.3e-6, the needle as thin as the dilation lets it be.
            println!("{name}: {error:.1e}");
            assert!(error < TOLERANCE / 10.0, "{name}: {error:.1e}");
            for gradient in gradients(&mut renderer, &map, &camera) {
                let rows = (0..3).flat_map(|i| row(&gradient, i));
                assert!(rows.clone().all(f32::is_finite), "{name}: {:?}", row(&gradient, 0));
            }
        }
    }
}

/// A needle along the diagonal of the pixels, its centre on a pixel: on its axis the exponent is
/// all but zero, and rounding must not take it for a positive one, which is skipped.
#[test]
fn a_long_needle_has_no_holes() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = Camera { fx: 32.0, fy: 32.0, cx: 16.0, cy: 16.0, ..straight(33, 33) };
    for log_length in [-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 6.0] {
        for turn in [22.5f32, 22.5001, 22.4999] {
            let mut scene = support::scene(46, 1, CHANNELS, 0.1);
            let (sin, cos) = turn.to_radians().sin_cos();
            scene.means[0] = [0.0, 0.0, 0.8];
            scene.color.rotations[0] = [cos, 0.0, 0.0, sin];
            scene.color.log_scales[0] = [log_length, -4.0, -4.0];
            scene.color.opacity_logits[0] = 0.0;
            let image = renderer.render_color(&map(&gpu, &scene), &camera).expect("renders");
            let axis: Vec<f32> = (0..33).map(|i| image.opacity[33 * i + i]).collect();
            assert!(axis.iter().all(|opacity| *opacity > 0.1), "{log_length}: {axis:?}");
        }
    }
}

/// Features that are not numbers, or not below 1e30, belong to no picture.
#[test]
fn a_bad_feature_is_not_drawn() {
    let gpu = support::gpu();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let camera = straight(37, 29);
    for poison in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
        let mut scene = support::scene(47, 20, CHANNELS, 0.1);
        scene.color.features[1] = poison;
        scene.language.features[2] = poison;
        let mut map = map(&gpu, &scene);
        assert!(
            pictures(trainer.renderer(), &map, &camera).iter().all(|v| v.is_finite()),
            "{poison}"
        );
        step(&gpu, &mut trainer, &mut map, &camera);
        let after = map.to_host().expect("reads");
        assert_eq!(
            bits(&after, 1..20).iter().filter(|b| !f32::from_bits(**b).is_finite()).count(),
            0
        );
    }
}

/// The near plane belongs to what is not drawn; a hair beyond it is.
#[test]
fn the_near_plane_is_where_it_says() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = straight(37, 29);
    for (z, drawn) in [(NEAR, false), (NEAR.next_up(), true), (NEAR.next_down(), false)] {
        let mut scene = support::scene(43, 1, CHANNELS, 0.01);
        scene.means[0] = [0.0, 0.0, z];
        let opacity = renderer.render_color(&map(&gpu, &scene), &camera).expect("renders").opacity;
        assert_eq!(opacity.iter().any(|value| *value > 0.0), drawn, "z {z}");
    }
}

#[test]
fn five_thousand_on_one_pixel_have_finite_gradients_and_a_sound_step() {
    let gpu = support::gpu();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let camera = straight(21, 19);
    let mut scene = support::scene(44, 5000, CHANNELS, 0.08);
    for (i, mean) in scene.means.iter_mut().enumerate() {
        *mean = camera.unproject(10.0, 9.0, 1.0 + 1e-4 * (i % 977) as f32).into();
        scene.color.opacity_logits[i] = -4.4;
        scene.language.opacity_logits[i] = if i.is_multiple_of(50) { 100.0 } else { -4.3 };
    }
    let mut map = map(&gpu, &scene);
    let image = trainer.renderer().render_color(&map, &camera).expect("renders");
    let wanted = Head::color(&scene).render(&View::new(&camera));
    let pairs = image.opacity.iter().zip(&wanted.transmittance);
    let error = pairs.map(|(a, t)| (f64::from(*a) - (1.0 - t)).abs()).fold(0.0, f64::max);
    // Measured on llvmpipe: 3.9e-7.
    println!("crowd: {error:.1e}");
    assert!(error < TOLERANCE, "{error:.1e}");
    assert!(image.opacity.iter().any(|opacity| *opacity > 0.99), "they add up");
    for gradient in gradients(trainer.renderer(), &map, &camera) {
        assert!((0..5000).flat_map(|i| row(&gradient, i)).all(f32::is_finite));
    }
    step(&gpu, &mut trainer, &mut map, &camera);
    let after = map.to_host().expect("reads");
    assert!(bits(&after, 0..5000).iter().all(|value| f32::from_bits(*value).is_finite()));
    assert!(after != scene, "something moved");
}

/// Pictures of odd sizes, a single pixel included, against the oracle.
#[test]
fn odd_sizes_match_the_oracle() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let scene = support::scene(45, 25, CHANNELS, 0.3);
    let map = map(&gpu, &scene);
    let mut other = scene.clone();
    other.color.opacity_logits[0] += 1.0;
    for (width, height) in [(1, 1), (1, 17), (17, 1), (15, 33), (16, 16), (31, 2), (65, 3)] {
        let camera = Camera { fx: 30.0, fy: 31.0, ..straight(width, height) };
        let image = renderer.render_color(&map, &camera).expect("renders");
        let error = |scene: &HostGaussians| {
            let wanted = Head::color(scene).render(&View::new(&camera)).image;
            let channels = image.rgb.chunks(3).zip(&image.depth);
            let found = channels.flat_map(|(rgb, depth)| [rgb[0], rgb[1], rgb[2], *depth]);
            found.zip(wanted).map(|(a, b)| (f64::from(a) - b).abs()).fold(0.0, f64::max)
        };
        let (error, control) = (error(&scene), error(&other));
        println!("{width}x{height}: {error:.1e}, control {control:.1e}");
        assert!(error < TOLERANCE, "{width}x{height}: {error:.1e}");
        assert!(control > TOLERANCE, "{width}x{height}: a changed gaussian must show");
        let found = gradients(&mut renderer, &map, &camera);
        assert!(row(&found[0], 0).iter().all(|g| g.is_finite()));
    }
}
