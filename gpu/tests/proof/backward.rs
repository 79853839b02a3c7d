//! Gradients of the kernels against the oracle's (which tests/oracle.rs holds against differences).

use crate::support;

use crate::oracle::Head;
use crate::oracle::project::View;
use lexsplat_gpu::{Camera, Gaussians, Gpu, HeadGradient, HostGaussians, Renderer};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Largest difference per kind of parameter over the largest gradient of that kind; measured worst
/// case on llvmpipe: 2.8e-6 (log scales, 300 small Gaussians).
const TOLERANCE: f64 = 2e-5;

/// Largest relative error of each kind: mean, rotation, log scale, opacity logit, feature.
type Errors = [f64; 5];

fn map(gpu: &Gpu, scene: &HostGaussians) -> Gaussians {
    let mut gaussians = Gaussians::new(gpu, scene.language.channels);
    gaussians.append(scene).expect("fits");
    gaussians
}

fn factors(seed: u64, len: usize) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.0f32..1.0)).collect()
}

fn widen(values: &[f32]) -> Vec<f64> {
    values.iter().map(|value| f64::from(*value)).collect()
}

fn relative(found: impl IntoIterator<Item = f32>, wanted: impl IntoIterator<Item = f64>) -> f64 {
    let (mut worst, mut largest, mut found) = (0.0f64, 0.0f64, found.into_iter());
    for wanted in wanted {
        let found = found.next().expect("as many gradients as parameters");
        worst = worst.max((f64::from(found) - wanted).abs());
        largest = largest.max(wanted.abs());
    }
    assert!(found.next().is_none() && largest > 0.0);
    worst / largest
}

fn errors(found: &HeadGradient, wanted: &Head) -> Errors {
    let shapes = || wanted.shapes.iter();
    [
        if found.means.is_empty() {
            0.0
        } else {
            relative(found.means.concat(), shapes().flat_map(|s| s.mean.data.0[0]))
        },
        relative(found.head.rotations.concat(), shapes().flat_map(|s| s.rotation.data.0[0])),
        relative(found.head.log_scales.concat(), shapes().flat_map(|s| s.log_scale.data.0[0])),
        relative(found.head.opacity_logits.iter().copied(), shapes().map(|s| s.opacity_logit)),
        relative(found.head.features.iter().copied(), wanted.features.iter().copied()),
    ]
}

fn color(renderer: &mut Renderer, map: &Gaussians, camera: &Camera, g: &[f32]) -> HeadGradient {
    let rows: Vec<[f32; 4]> = g.chunks(4).map(|row| [row[0], row[1], row[2], row[3]]).collect();
    renderer.color_gradients(map, camera, &rows).expect("runs")
}

#[test]
fn gradients_match_the_oracle() {
    let gpu = support::gpu();
    for (seed, count, channels, size, (width, height)) in [
        (1, 1, 3, 0.2, (16, 16)),
        (2, 60, 15, 0.1, (67, 45)),
        (3, 300, 15, 0.03, (33, 64)),
        (4, 40, 1, 0.4, (50, 17)),
        (5, 30, 64, 0.15, (31, 31)),
    ] {
        let mut renderer = Renderer::new(&gpu, channels).expect("compiles");
        let scene = support::scene(seed, count, channels, size);
        let map = map(&gpu, &scene);
        let camera = support::camera(width, height);
        let view = View::new(&camera);
        for is_color in [true, false] {
            let head = if is_color { Head::color(&scene) } else { Head::language(&scene) };
            let g = factors(seed, camera.pixels() * head.picture_channels());
            let found = if is_color {
                color(&mut renderer, &map, &camera, &g)
            } else {
                renderer.language_gradients(&map, &camera, &g).expect("runs")
            };
            let found_errors = errors(&found, &head.gradients(&view, &widen(&g)));
            println!("seed {seed} color {is_color}: {found_errors:?}");
            assert!(found_errors.iter().all(|e| *e < TOLERANCE), "seed {seed}: {found_errors:?}");
            assert_eq!(found.means.is_empty(), !is_color, "language does not move means");
            let pose = found.pose.iter().copied();
            if is_color {
                let wanted = head.pose_gradient(&view, &widen(&g));
                let error = relative(pose, wanted.iter().copied());
                println!("seed {seed} pose: {error:.1e}");
                assert!(error < TOLERANCE, "seed {seed} pose: {error:.1e}");
                let control = relative(found.pose, wanted.iter().map(|g| 1.001 * g));
                assert!(control > TOLERANCE, "seed {seed} pose: {control:.1e}");
            } else {
                assert_eq!(found.pose, [0.0; 6], "language does not move the camera");
            }

            let mut other = g.clone();
            other.iter_mut().for_each(|g| *g *= 1.001);
            let control = errors(&found, &head.gradients(&view, &widen(&other)));
            let first = usize::from(!is_color);
            assert!(control[first..].iter().all(|e| *e > TOLERANCE), "control: {control:?}");
        }
    }
}

#[test]
fn the_code_gradient_comes_from_every_pixel() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let scene = support::scene(6, 50, 15, 0.1);
    let map = map(&gpu, &scene);
    let camera = support::camera(67, 45);
    let head = Head::language(&scene);
    let ones = vec![1.0f32; camera.pixels() * 15];
    let corner = |pixel: usize| (pixel % 67).is_multiple_of(16) && (pixel / 67).is_multiple_of(16);
    let corners: Vec<f32> = (0..ones.len()).map(|i| f32::from(u8::from(corner(i / 15)))).collect();
    let found = renderer.language_gradients(&map, &camera, &ones).expect("runs");
    let against = |g: &[f32]| errors(&found, &head.gradients(&View::new(&camera), &widen(g)))[4];
    assert!(against(&ones) < TOLERANCE, "{}", against(&ones));
    assert!(against(&corners) > 0.5, "one pixel per tile is not the gradient");
}

#[test]
fn gradients_are_the_same_twice_and_after_an_overflow() {
    let gpu = support::gpu();
    let scene = support::scene(7, 200, 15, 0.2);
    let map = map(&gpu, &scene);
    let camera = support::camera(67, 45);
    let (c, l) = (factors(1, camera.pixels() * 4), factors(2, camera.pixels() * 15));
    let run = |renderer: &mut Renderer| {
        let language = renderer.language_gradients(&map, &camera, &l).expect("runs");
        (color(renderer, &map, &camera, &c), language)
    };
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let first = run(&mut renderer);
    assert_eq!(run(&mut renderer), first, "bit for bit");
    let mut small = Renderer::with_hit_capacity(&gpu, 15, 3).expect("compiles");
    assert_eq!(run(&mut small), first, "bit for bit");
}

#[test]
fn poisoned_and_hidden_gaussians_get_no_gradient() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, 15).expect("compiles");
    let camera = support::camera(67, 45);
    let mut scene = support::scene(8, 40, 15, 0.1);
    scene.means[0] = camera.unproject(30.0, 20.0, -2.0).into();
    scene.means[1][2] = f32::NAN;
    scene.color.rotations[2] = [0.0; 4];
    scene.color.log_scales[3] = [f32::INFINITY; 3];
    scene.color.opacity_logits[4] = -1e9;
    scene.color.opacity_logits[5] = 1e9;
    scene.color.log_scales[6] = [-1e9; 3];
    let g = factors(3, camera.pixels() * 4);
    let found = color(&mut renderer, &map(&gpu, &scene), &camera, &g);
    let flat = |i: usize| {
        let head = &found.head;
        [
            &found.means[i][..],
            &head.rotations[i],
            &head.log_scales[i],
            &head.opacity_logits[i..=i],
            &head.features[3 * i..3 * i + 3],
        ]
        .concat()
    };
    for i in 0..40 {
        assert!(flat(i).iter().all(|g| g.is_finite()), "gaussian {i}: {:?}", flat(i));
        assert!(i >= 5 || flat(i).iter().all(|g| *g == 0.0), "gaussian {i}: {:?}", flat(i));
    }
    assert!((7..40).any(|i| flat(i).iter().any(|g| *g != 0.0)), "the others have one");
}
