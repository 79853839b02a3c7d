//! Tiers: whatever a device may use, pictures, gradients and losses are the portable tier's. Loops
//! over every tier that the adapter may have, so that a kernel that goes by the tier is tested
//! without a word here.

use crate::support;

use lexsplat_gpu::selftest::shaders as self_tests;
use lexsplat_gpu::{
    Gaussians, Gpu, HostGaussians, LanguageTarget, LearningRates, LossWeights, Tier, Trainer,
    TrainingView,
};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Largest difference from the portable tier; measured worst case on llvmpipe: 6.6e-7.
const TOLERANCE: f32 = 2e-5;
const CHANNELS: usize = 16;

/// Everything that a device makes of a scene: pictures, gradients over the largest, a
/// step's losses.
fn results(gpu: &Gpu, scene: &HostGaussians) -> Vec<f32> {
    let camera = support::camera(67, 45);
    let mut trainer = Trainer::new(gpu, CHANNELS).expect("compiles");
    let mut map = Gaussians::new(gpu, CHANNELS);
    map.append(scene).expect("fits");
    let renderer = trainer.renderer();
    let color = renderer.render_color(&map, &camera).expect("renders");
    let given = renderer.contributions(&map, &camera).expect("renders");
    let weights = given.iter().map(|given| given.weight / camera.pixels() as f32).collect();
    let language = renderer.render_language(&map, &camera).expect("renders");
    let mut all = [color.rgb, color.depth, color.opacity, weights, language.codes].concat();

    let ramp = |i: usize| (i % 17) as f32 / 17.0 - 0.4;
    let rows: Vec<[f32; 4]> =
        (0..camera.pixels()).map(|i| std::array::from_fn(|k| ramp(4 * i + k))).collect();
    let codes: Vec<f32> = (0..camera.pixels() * CHANNELS).map(ramp).collect();
    let gradients = [
        renderer.color_gradients(&map, &camera, &rows).expect("runs"),
        renderer.language_gradients(&map, &camera, &codes).expect("runs"),
    ];
    for gradient in gradients {
        let head = gradient.head;
        let kinds = [
            gradient.means.concat(),
            head.rotations.concat(),
            head.log_scales.concat(),
            head.opacity_logits,
            head.features,
        ];
        for kind in kinds {
            let largest = kind.iter().fold(f32::MIN_POSITIVE, |most, g| most.max(g.abs()));
            all.extend(kind.iter().map(|g| g / largest));
        }
    }

    let targets = vec![0.5; camera.pixels() * CHANNELS];
    let target = LanguageTarget::new(gpu, 67, 45, CHANNELS, &targets).expect("fits");
    let view = TrainingView {
        camera: &camera,
        color: None,
        language: Some((&camera, &target)),
        exposure: [0.0; 2],
        focus: None,
    };
    let (weights, rates) = (LossWeights::default(), LearningRates::default());
    trainer.step(&mut map, &view, &weights, &rates).expect("steps");
    let losses = trainer.last_report(&mut map).expect("settles").losses;
    all.extend([losses.language, losses.tie]);
    all
}

fn furthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    assert!(a.iter().chain(b).all(|value| value.is_finite()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn every_tier_gives_what_the_portable_one_gives() {
    let scene = support::scene(31, 200, CHANNELS, 0.1);
    let portable = support::gpu_of_tier("portable");
    let wanted = results(&portable, &scene);
    for tier in portable.tiers() {
        let gpu = support::gpu_of_tier(tier.name());
        assert_eq!(gpu.tier(), *tier);
        let difference = furthest(&results(&gpu, &scene), &wanted);
        println!("{}: {difference:.1e}", tier.name());
        assert!(difference < TOLERANCE, "{}: {difference:.1e}", tier.name());
    }
    let mut other = scene.clone();
    other.means[0][0] += 0.01;
    let control = furthest(&results(&portable, &other), &wanted);
    assert!(control > TOLERANCE, "a moved gaussian must show: {control:.1e}");
}

#[test]
fn self_tests_need_no_more_than_their_tier() {
    let tiers = [Tier::Portable, Tier::Software, Tier::Subgroup { min: 32, max: 32 }];
    for tier in tiers.into_iter().chain([Tier::Subgroup { min: 8, max: 32 }]) {
        let shaders = self_tests(tier);
        assert_eq!(shaders.len(), 1 + usize::from(tier != Tier::Portable));
        for (i, shader) in shaders.iter().enumerate() {
            let text = shader.compose();
            let module = naga::front::wgsl::parse_str(&text)
                .unwrap_or_else(|error| panic!("{}", error.emit_to_string(&text)));
            let valid = |capabilities| {
                Validator::new(ValidationFlags::all(), capabilities).validate(&module).is_ok()
            };
            assert_eq!(valid(Capabilities::empty()), i == 0, "{} of {tier:?}", shader.label);
            assert!(valid(Capabilities::SUBGROUP), "{} of {tier:?}", shader.label);
        }
    }
}
