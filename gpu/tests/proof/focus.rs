//! Steps that look at some tiles of a view: they do what a step on a target with nothing but those tiles
//! does, and leave the rest alone.

use crate::support;
use crate::training::{DATA, map};

use lexsplat_gpu::{
    Camera, ColorTarget, Focus, Gpu, HostGaussians, LearningRates, LossWeights, Renderer, Trainer,
    TrainingView,
};

/// All tiles.
const ALL: Focus = Focus { mean_share: 0.0, least_share: 1.0, turn: 0 };
/// Tiles with four times the mean error, and hardly one with less than a hundredth of it.
const WORST: Focus = Focus { mean_share: 0.26, least_share: 0.0, turn: 3 };
/// A color of the columns that differ.
const BRIGHTER: fn(f32) -> f32 = |shown| shown + 0.3;
/// Columns of the picture that differ from the map: a quarter, and whole tiles of each size.
const WRONG: usize = 16;

/// A view of a scene whose leftmost columns have other colors than the map.
struct Case {
    camera: Camera,
    scene: HostGaussians,
    rgb: Vec<u8>,
    shown: Vec<f32>,
}

impl Case {
    /// `wrong`: the color of the leftmost columns, from what the map shows there.
    fn new(gpu: &Gpu, wrong: fn(f32) -> f32) -> Self {
        let camera = support::camera(64, 48);
        let mut scene = support::scene(51, 300, 3, 0.05);
        // One over all tiles, which has no mask.
        scene.color.log_scales[0] = [1.0; 3];
        scene.color.opacity_logits[0] = 0.0;
        let mut renderer = Renderer::new(gpu, 3).expect("compiles");
        let shown = renderer.render_color(&map(gpu, &scene), &camera).expect("renders").rgb;
        let byte = |(at, value): (usize, &f32)| {
            let wanted = if at / 3 % 64 < WRONG { wrong(*value) } else { *value };
            (wanted.min(1.0) * 255.0).round() as u8
        };
        let rgb = shown.iter().enumerate().map(byte).collect();
        Self { camera, scene, rgb, shown }
    }

    fn target(&self, gpu: &Gpu, columns: usize) -> ColorTarget {
        let no_depth = vec![0.0; 64 * 48];
        ColorTarget::masked(gpu, 64, 48, &self.rgb, &no_depth, |pixel| pixel % 64 < columns)
            .expect("fits")
    }

    /// The map after one step, and the term of color.
    fn step(
        &self,
        gpu: &Gpu,
        most_hits: usize,
        target: &ColorTarget,
        focus: Option<Focus>,
    ) -> (HostGaussians, f32) {
        let mut trainer = Trainer::new(gpu, 3).expect("compiles");
        trainer.renderer().limit_lists(most_hits);
        self.step_of(gpu, trainer, target, focus)
    }

    fn step_of(
        &self,
        gpu: &Gpu,
        mut trainer: Trainer,
        target: &ColorTarget,
        focus: Option<Focus>,
    ) -> (HostGaussians, f32) {
        let mut gaussians = map(gpu, &self.scene);
        let (camera, color) = (&self.camera, Some(target));
        let view = TrainingView { camera, color, language: None, exposure: [0.0; 2], focus };
        let weights = LossWeights { depth: 0.0, ..DATA };
        trainer.step(&mut gaussians, &view, &weights, &LearningRates::default()).expect("steps");
        let report = trainer.last_report(&mut gaussians).expect("reads");
        (gaussians.to_host().expect("reads"), report.losses.color)
    }
}

/// The largest difference of any parameter of color and mean.
fn apart(one: &HostGaussians, other: &HostGaussians) -> f32 {
    let values = |host: &HostGaussians| -> Vec<f32> {
        let (means, color) = (host.means.as_flattened(), &host.color);
        let shapes = [color.rotations.as_flattened(), color.log_scales.as_flattened()].concat();
        [means, &shapes, &color.opacity_logits, &color.features].concat()
    };
    let pairs = values(one).into_iter().zip(values(other));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn tiles_that_are_left_out_are_as_if_they_had_no_target() {
    // The two make lists in two ways (on llvmpipe).
    for gpu in [support::gpu(), support::gpu_of_tier("portable")] {
        let case = Case::new(&gpu, BRIGHTER);
        let target = case.target(&gpu, 64);
        let (whole, loss) = case.step(&gpu, usize::MAX, &target, Some(WORST));
        let (unfocused, same_loss) = case.step(&gpu, usize::MAX, &case.target(&gpu, 64), None);
        assert_eq!((&whole, loss), (&unfocused, same_loss), "nothing was measured before");

        let (focused, part) = case.step(&gpu, usize::MAX, &target, Some(WORST));
        let (masked, _) = case.step(&gpu, usize::MAX, &case.target(&gpu, WRONG), None);
        let (found, control) = (apart(&focused, &masked), apart(&whole, &masked));
        println!("apart {found:.1e}, of a step on all tiles {control:.1e}");
        // Measured on llvmpipe: 1.5e-8 and 0.1.
        assert!(found < 1e-6 && control > 1e-4, "{found} {control}");

        let error = |at: usize| (case.shown[at] - f32::from(case.rgb[at]) / 255.0).abs();
        let wrong = (0..case.shown.len()).filter(|at| at / 3 % 64 < WRONG).map(error);
        let wanted = wrong.sum::<f32>() / case.shown.len() as f32;
        assert!((part / wanted - 1.0).abs() < 1e-4, "{part} {wanted}");
        assert!(part < 0.999 * loss, "the rest has an error, too: {part} {loss}");
    }
}

#[test]
fn a_focus_on_all_tiles_changes_no_bit() {
    let gpu = support::gpu();
    let case = Case::new(&gpu, BRIGHTER);
    let target = case.target(&gpu, 64);
    case.step(&gpu, usize::MAX, &target, Some(ALL));
    let step = |focus| case.step(&gpu, usize::MAX, &target, focus);
    assert_eq!(step(Some(ALL)), step(None));
    assert_ne!(step(Some(WORST)), step(None), "negative control");
    assert_eq!(step(Some(ALL)), step(None), "no tile stays left out");
}

#[test]
fn bands_change_no_bit_of_a_step_with_a_focus() {
    for gpu in [support::gpu(), support::gpu_of_tier("portable")] {
        let case = Case::new(&gpu, BRIGHTER);
        let target = case.target(&gpu, 64);
        let focus = Focus { mean_share: 0.5, least_share: 0.5, turn: 7 };
        case.step(&gpu, usize::MAX, &target, Some(ALL));
        let whole = case.step(&gpu, usize::MAX, &target, Some(focus));
        case.step(&gpu, usize::MAX, &target, Some(ALL));
        assert_eq!(case.step(&gpu, 900, &target, Some(focus)), whole);
        case.step(&gpu, usize::MAX, &target, Some(ALL));
        let turned = Focus { turn: 8, ..focus };
        assert_ne!(case.step(&gpu, 900, &target, Some(turned)), whole, "other tiles");
    }
}

#[test]
fn a_step_that_is_repeated_draws_the_same_tiles() {
    let gpu = support::gpu();
    // Black, as a picture without its hits, whose errors must not count.
    let case = Case::new(&gpu, |_| 0.0);
    let focus = Focus { mean_share: 0.5, least_share: 0.2, turn: 7 };
    let step = |hits: usize| {
        let target = case.target(&gpu, 64);
        case.step(&gpu, usize::MAX, &target, Some(ALL));
        let trainer = Trainer::with_hit_capacity(&gpu, 3, hits).expect("compiles");
        let taken = case.step_of(&gpu, trainer, &target, Some(focus));
        (taken, target.tile_errors(&gpu).expect("reads"))
    };
    let (whole, repeated) = (step(1 << 16), step(64));
    assert_eq!(repeated, whole, "its lists overflowed at first");
    let measured = whole.1.iter().all(|error| *error < 1.0);
    assert!(measured && whole.1.iter().any(|error| *error > 0.0), "{:?}", whole.1);
}
