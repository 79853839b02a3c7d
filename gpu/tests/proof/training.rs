//! Whole training steps: what they move, what they leave alone, what they report.

use crate::support;

use crate::oracle;
use crate::oracle::Head;
use crate::oracle::project::View;
use lexsplat_gpu::{
    Camera, ColorTarget, Gaussians, Gpu, HostGaussians, LanguageTarget, LearningRates, LossWeights,
    Losses, Renderer, Trainer, TrainingView,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub fn map(gpu: &Gpu, scene: &HostGaussians) -> Gaussians {
    let mut gaussians = Gaussians::new(gpu, scene.language.channels);
    gaussians.append(scene).expect("fits");
    gaussians
}

/// A scene's own pictures as targets, color at the camera's size and language at a third of it.
pub struct Targets {
    camera: Camera,
    labels: Camera,
    color: ColorTarget,
    language: LanguageTarget,
}

impl Targets {
    pub fn new(gpu: &Gpu, scene: &HostGaussians) -> Self {
        let mut renderer = Renderer::new(gpu, scene.language.channels).expect("compiles");
        let map = map(gpu, scene);
        let camera = support::camera(67, 45);
        let labels = camera.resized(33, 22);
        let image = renderer.render_color(&map, &camera).expect("renders");
        let rgb: Vec<u8> = image.rgb.iter().map(|v| (v * 255.0).round() as u8).collect();
        let codes = renderer.render_language(&map, &labels).expect("renders");
        Self {
            color: ColorTarget::new(gpu, 67, 45, &rgb, &image.depth).expect("fits"),
            language: LanguageTarget::new(gpu, 33, 22, codes.channels, &codes.codes).expect("fits"),
            camera,
            labels,
        }
    }

    pub fn view(&self, color: bool, language: bool) -> TrainingView<'_> {
        TrainingView {
            camera: &self.camera,
            color: color.then_some(&self.color),
            language: language.then_some((&self.labels, &self.language)),
            exposure: [0.0; 2],
            focus: None,
        }
    }
}

/// Only the terms that compare pictures.
pub const DATA: LossWeights =
    LossWeights { color: 1.0, depth: 0.2, language: 1.0, isotropic: 0.0, tie: 0.0 };

/// A scene with every parameter a little off.
pub fn disturbed(scene: &HostGaussians) -> HostGaussians {
    let rng = &mut ChaCha8Rng::seed_from_u64(99);
    let mut scene = scene.clone();
    let mut off = |size: f32| size * rng.random_range(-1.0f32..1.0);
    scene.means.iter_mut().flatten().for_each(|v| *v += off(0.03));
    for head in [&mut scene.color, &mut scene.language] {
        head.log_scales.iter_mut().flatten().for_each(|v| *v += off(0.3));
        head.opacity_logits.iter_mut().for_each(|v| *v += off(0.5));
        head.features.iter_mut().for_each(|v| *v += off(0.3));
    }
    scene
}

pub fn train(
    trainer: &mut Trainer,
    map: &mut Gaussians,
    view: &TrainingView<'_>,
    steps: usize,
) -> Vec<Losses> {
    let rates = LearningRates::default();
    let mut step = |_| {
        trainer.step(map, view, &DATA, &rates).expect("steps");
        trainer.last_report(map).expect("reads").losses
    };
    (0..steps).map(&mut step).collect()
}

#[test]
fn color_and_language_converge() {
    let gpu = support::gpu();
    let scene = support::scene(1, 150, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let mut map = map(&gpu, &disturbed(&scene));
    let losses = train(&mut trainer, &mut map, &targets.view(true, true), 200);
    let (first, last) = (losses[0], losses[199]);
    println!("{first:?}\n{last:?}");
    assert!(last.color < 0.3 * first.color, "{} to {}", first.color, last.color);
    assert!(last.depth < 0.5 * first.depth, "{} to {}", first.depth, last.depth);
    assert!(last.language < 0.3 * first.language, "{} to {}", first.language, last.language);
}

#[test]
fn language_alone_leaves_means_and_color_alone() {
    let gpu = support::gpu();
    let scene = support::scene(2, 100, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let before = disturbed(&scene);
    let mut map = map(&gpu, &before);
    let losses = train(&mut trainer, &mut map, &targets.view(false, true), 5);
    let after = map.to_host().expect("reads");
    assert_eq!((&after.means, &after.color), (&before.means, &before.color));
    assert_ne!(after.language.features, before.language.features);
    assert_ne!(after.language.rotations, before.language.rotations);
    assert_ne!(after.language.log_scales, before.language.log_scales);
    assert_ne!(after.language.opacity_logits, before.language.opacity_logits);
    assert!(losses[0].color == 0.0 && losses[0].language > 0.0);

    train(&mut trainer, &mut map, &targets.view(true, false), 5);
    let color = map.to_host().expect("reads");
    assert_eq!(color.language, after.language);
    assert_ne!(color.means, after.means);
}

#[test]
fn steps_are_the_same_twice_and_when_lists_overflow() {
    let gpu = support::gpu();
    let scene = support::scene(3, 150, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let run = |hits| {
        let mut trainer = Trainer::with_hit_capacity(&gpu, 15, hits).expect("compiles");
        let mut map = map(&gpu, &disturbed(&scene));
        let losses = train(&mut trainer, &mut map, &targets.view(true, true), 4);
        (losses, map.to_host().expect("reads"))
    };
    let first = run(1 << 16);
    assert_eq!(run(1 << 16), first, "bit for bit");
    assert_eq!(run(5), first, "an overflow changes nothing");
}

#[test]
fn unseen_gaussians_stay_as_they_are() {
    let gpu = support::gpu();
    let mut scene = support::scene(4, 100, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    for i in 0..10 {
        scene.means[i] = targets.camera.unproject(30.0, 20.0, -1.0 - i as f32).into();
    }
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let mut map = map(&gpu, &scene);
    let all = LossWeights { isotropic: 10.0, tie: 10.0, ..DATA };
    for _ in 0..3 {
        let view = targets.view(true, true);
        trainer.step(&mut map, &view, &all, &LearningRates::default()).expect("steps");
    }
    trainer.settle(&mut map).expect("settles");
    let after = map.to_host().expect("reads");
    assert_eq!(after.means[..10], scene.means[..10]);
    assert_eq!(after.color.log_scales[..10], scene.color.log_scales[..10]);
    assert_eq!(after.language.log_scales[..10], scene.language.log_scales[..10]);
    assert_ne!(after.means[10..], scene.means[10..]);
}

#[test]
fn values_that_are_not_finite_do_not_spread() {
    let gpu = support::gpu();
    let scene = support::scene(5, 60, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let mut poisoned = scene.clone();
    poisoned.means[0][0] = f32::NAN;
    poisoned.color.rotations[1] = [0.0; 4];
    poisoned.color.log_scales[2] = [f32::INFINITY; 3];
    poisoned.language.log_scales[3] = [f32::NAN; 3];
    poisoned.color.opacity_logits[4] = 1e9;
    poisoned.language.features[5 * 15] = 1e25;
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let mut map = map(&gpu, &poisoned);
    let all = LossWeights { isotropic: 10.0, tie: 10.0, ..DATA };
    for _ in 0..3 {
        let view = targets.view(true, true);
        trainer.step(&mut map, &view, &all, &LearningRates::default()).expect("steps");
    }
    trainer.settle(&mut map).expect("settles");
    let after = map.to_host().expect("reads");
    assert!(after.means[1..].iter().flatten().all(|v| v.is_finite()));
    for head in [&after.color, &after.language] {
        assert!(head.rotations.iter().flatten().all(|v| v.is_finite()));
        assert!(head.log_scales[4..].iter().flatten().all(|v| v.is_finite()));
        assert!(head.opacity_logits.iter().chain(&head.features).all(|v| v.is_finite()));
    }
    assert_ne!(after.means[10..], scene.means[10..], "the others learn");
}

#[test]
fn wrong_targets_are_refused_and_empty_steps_do_nothing() {
    let gpu = support::gpu();
    let scene = support::scene(6, 5, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let mut map = map(&gpu, &scene);
    let other = support::camera(66, 45);
    let view = TrainingView { camera: &other, ..targets.view(true, false) };
    let (weights, rates) = (LossWeights::default(), LearningRates::default());
    let error = trainer.step(&mut map, &view, &weights, &rates).expect_err("another size");
    assert_eq!(error.to_string(), "target width: expected 66, found 67");
    trainer.step(&mut map, &targets.view(false, false), &weights, &rates).expect("nothing to do");
    assert_eq!(map.to_host().expect("reads"), scene);
    let mut empty = Gaussians::new(&gpu, 15);
    trainer.step(&mut empty, &targets.view(true, true), &weights, &rates).expect("nothing to do");
    assert!(LanguageTarget::new(&gpu, 1, 1, 2, &[0.0, f32::NAN]).is_err());
    assert!(ColorTarget::new(&gpu, 2, 1, &[0; 6], &[0.0]).is_err());
}

/// The report's pose and exposure gradients are those of the loss: against the oracles, on a scene
/// whose target is another one.
#[test]
fn a_step_reports_pose_and_exposure_gradients() {
    let gpu = support::gpu();
    let scene = support::scene(6, 80, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let off = disturbed(&scene);
    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let mut gaussians = map(&gpu, &off);
    let image = trainer.renderer().render_color(&gaussians, &targets.camera).expect("renders");
    let exposure = [0.2f32, 0.05];
    let view = TrainingView { exposure, ..targets.view(true, true) };
    trainer.step(&mut gaussians, &view, &DATA, &LearningRates::default()).expect("steps");
    let report = trainer.last_report(&mut gaussians).expect("reads");

    let shown = Renderer::new(&gpu, 15)
        .expect("compiles")
        .render_color(&map(&gpu, &scene), &targets.camera)
        .expect("renders");
    let target = |v: f32| f64::from((v * 255.0).round() / 255.0);
    let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|v| f64::from(*v)).collect() };
    let colors: Vec<_> = shown.rgb.iter().map(|v| Some(target(*v))).collect();
    let depths: Vec<_> = shown.depth.iter().map(|d| (*d > 0.0).then_some(f64::from(*d))).collect();
    let (_, d_rgb, d_exposure) =
        oracle::loss::exposed(1.0, exposure.map(f64::from), &wide(&image.rgb), &colors);
    let (_, d_depth) = oracle::loss::mean_absolute(0.2f32.into(), &wide(&image.depth), &depths);
    let d_image: Vec<f64> = d_rgb
        .chunks(3)
        .zip(&d_depth)
        .flat_map(|(rgb, depth)| [rgb[0], rgb[1], rgb[2], *depth])
        .collect();
    let camera = View::new(&targets.camera);
    let wanted = Head::color(&off).pose_gradient(&camera, &d_image);
    // Measured on llvmpipe: 3.3e-7 of the largest.
    let largest = wanted.amax();
    for axis in 0..6 {
        let error = (f64::from(report.pose_gradient[axis]) - wanted[axis]).abs() / largest;
        println!("pose {axis}: {error:.1e}");
        assert!(error < 1e-5, "axis {axis}: {:?} {wanted:?}", report.pose_gradient);
    }
    assert!((f64::from(report.pose_gradient[0]) + wanted[0]).abs() > 1e-5 * largest, "the sign");
    for (found, wanted) in report.exposure_gradient.into_iter().zip(d_exposure) {
        assert!((f64::from(found) - wanted).abs() < 1e-5, "exposure: {found} {wanted}");
        assert!(wanted.abs() > 1e-3, "the gradient is not small");
    }
}

/// A look reports what a step on the same view reports, and moves neither parameters nor moments:
/// behind it, or behind steps that nobody waited for, or where its list overflows.
#[test]
fn a_look_reports_the_same_as_a_step_and_moves_nothing() {
    let gpu = support::gpu();
    let scene = support::scene(11, 200, 15, 0.12);
    let targets = Targets::new(&gpu, &scene);
    let before = disturbed(&scene);
    let exposure = [0.1f32, -0.02];
    let view = TrainingView { exposure, ..targets.view(true, false) };
    let (camera, color) = (&targets.camera, &targets.color);
    let rates = LearningRates::default();
    let steps = 3;
    // Behind some steps: a look (or none), then what the next step finds and where everything is.
    let run = |hits, look: bool| {
        let mut trainer = Trainer::with_hit_capacity(&gpu, 15, hits).expect("compiles");
        let mut gaussians = map(&gpu, &before);
        for _ in 0..steps {
            trainer.step(&mut gaussians, &view, &DATA, &rates).expect("steps");
        }
        let looked =
            look.then(|| trainer.look(&gaussians, camera, color, exposure, &DATA).expect("looks"));
        trainer.step(&mut gaussians, &view, &DATA, &rates).expect("steps");
        let report = trainer.last_report(&mut gaussians).expect("reads");
        (looked, report, gaussians.to_host().expect("reads"))
    };
    let (_, wanted, wanted_map) = run(1 << 16, false);
    for hits in [1 << 16, 300] {
        let (looked, report, moved) = run(hits, true);
        assert_eq!(looked, Some(wanted), "what the step behind it finds, {hits} hits");
        assert_eq!((report, &moved), (wanted, &wanted_map), "as if nobody had looked");
    }
    assert_ne!(wanted.pose_gradient, [0.0; 6]);

    let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
    let gaussians = map(&gpu, &before);
    let first = trainer.look(&gaussians, camera, color, exposure, &DATA).expect("looks");
    assert_eq!(gaussians.to_host().expect("reads"), before, "a look alone moves nothing");
    assert_ne!(first, wanted, "steps change what a look finds");
    let plain = trainer.look(&gaussians, camera, color, [0.0; 2], &DATA).expect("looks");
    assert_ne!(first, plain, "and so does exposure");
    let isotropic = LossWeights { isotropic: 10.0, tie: 5.0, ..DATA };
    let same = trainer.look(&gaussians, camera, color, exposure, &isotropic).expect("looks");
    assert_eq!(same.losses, first.losses, "only pictures are compared");
    let empty = Gaussians::new(&gpu, 15);
    let nothing = trainer.look(&empty, camera, color, exposure, &DATA).expect("looks");
    assert_eq!(nothing, lexsplat_gpu::StepReport::default());
    let wrong = targets.camera.resized(30, 20);
    assert!(trainer.look(&gaussians, &wrong, color, exposure, &DATA).is_err());
}

/// A list that overflows in the middle of a sequence loses no step: the same losses, step by step.
#[test]
fn a_step_that_overflows_is_taken_again() {
    let gpu = support::gpu();
    let few = support::scene(7, 30, 15, 0.05);
    let many = support::scene(8, 400, 15, 0.15);
    let targets = Targets::new(&gpu, &many);
    let run = |hits| {
        let mut trainer = Trainer::with_hit_capacity(&gpu, 15, hits).expect("compiles");
        let mut gaussians = map(&gpu, &few);
        let view = targets.view(true, true);
        let mut step = |gaussians: &mut Gaussians| {
            trainer.step(gaussians, &view, &DATA, &LearningRates::default()).expect("steps");
        };
        (0..3).for_each(|_| step(&mut gaussians));
        gaussians.append(&many).expect("fits");
        (0..5).for_each(|_| step(&mut gaussians));
        let report = trainer.last_report(&mut gaussians).expect("reads");
        (report, gaussians.to_host().expect("reads"))
    };
    let wanted = run(1 << 16);
    assert_eq!(run(1 << 16), wanted, "bit for bit");
    assert_eq!(run(2000), wanted, "nothing is lost");
    let mut shorter = Trainer::new(&gpu, 15).expect("compiles");
    let mut gaussians = map(&gpu, &few);
    gaussians.append(&many).expect("fits");
    let view = targets.view(true, true);
    shorter.step(&mut gaussians, &view, &DATA, &LearningRates::default()).expect("steps");
    shorter.settle(&mut gaussians).expect("settles");
    assert_ne!(gaussians.to_host().expect("reads"), wanted.1, "fewer steps show");
}

/// Views that are too large to be on the device together are made again for each step, in buffers of others.
#[test]
fn targets_that_come_and_go_train_as_those_that_stay() {
    let gpu = support::gpu();
    let scene = disturbed(&support::scene(7, 60, 15, 0.12));
    let camera = support::camera(1200, 900);
    let pixels = camera.pixels();
    let pictures: Vec<(Vec<u8>, Vec<f32>)> = [10u8, 90, 170]
        .into_iter()
        .map(|base| {
            let rgb = (0..3 * pixels).map(|at| base + (at % 71) as u8).collect();
            (rgb, (0..pixels).map(|at| (at % 5) as f32 * f32::from(base) * 0.01).collect())
        })
        .collect();
    let stays = |(rgb, depth): &(Vec<u8>, Vec<f32>)| {
        ColorTarget::new(&gpu, 1200, 900, rgb, depth).expect("fits")
    };
    let comes = |(rgb, depth): &(Vec<u8>, Vec<f32>)| {
        ColorTarget::of_picture(1200, 900, rgb[..].into(), depth[..].into()).expect("fits")
    };
    let trained = |targets: &[ColorTarget], order: [usize; 5]| {
        let mut trainer = Trainer::new(&gpu, 15).expect("compiles");
        let mut map = map(&gpu, &scene);
        for at in order {
            let color = Some(&targets[at]);
            let view = TrainingView {
                camera: &camera,
                color,
                language: None,
                exposure: [0.0; 2],
                focus: None,
            };
            trainer.step(&mut map, &view, &DATA, &LearningRates::default()).expect("steps");
        }
        trainer.settle(&mut map).expect("takes them");
        map.to_host().expect("reads")
    };
    let staying: Vec<ColorTarget> = pictures.iter().map(stays).collect();
    let coming: Vec<ColorTarget> = pictures.iter().map(comes).collect();
    let wanted = trained(&staying, [0, 1, 2, 0, 1]);
    assert!(trained(&coming, [0, 1, 2, 0, 1]) == wanted, "bit for bit");
    assert!(trained(&coming, [0, 1, 2, 0, 1]) == wanted, "with another trainer too");
    assert!(trained(&coming, [0, 1, 2, 0, 2]) != wanted, "negative control: another last view");
    assert!(ColorTarget::of_picture(2, 1, [0; 6][..].into(), [0.0][..].into()).is_err());
}
