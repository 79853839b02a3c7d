//! Any bytes make a scene, and whatever the scene, the renderer keeps its promises. Shared by
//! `cargo test` (seeded bytes, see fuzz.rs) and by the fuzz target in gpu/fuzz (bytes that a fuzzer
//! finds).
//!
//! Features are kept finite and below 1e30 in size: what the renderer makes of others is in
//! poison.rs.

use lexsplat_gpu::{
    Camera, ColorTarget, Gaussians, Gpu, GpuError, HostGaussians, HostHead, LanguageTarget,
    LearningRates, LossWeights, Renderer, Trainer, TrainingView,
};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// Channels of the language head.
pub const CHANNELS: usize = 5;
/// Most Gaussians of a scene.
const MOST: usize = 48;
/// Most columns and rows of a picture.
const SIDE: u8 = 40;

/// Values that arithmetic trips over; one byte in sixteen picks from here.
const WILD: [f32; 16] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    1e-40,
    1e-20,
    -1e20,
    1e20,
    f32::MAX,
    f32::MIN,
    46.0,
    -46.0,
    100.0,
    -100.0,
    0.1,
];

/// What became of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The camera was refused, rightly.
    Refused,
    /// A picture without anything in it.
    Empty,
    /// A picture with something in it.
    Drawn,
}

/// Bytes as values; zeros without end after the last.
struct Reader<'a>(std::slice::Iter<'a, u8>);

impl Reader<'_> {
    fn byte(&mut self) -> u8 {
        self.0.next().copied().unwrap_or(0)
    }

    fn is_empty(&self) -> bool {
        self.0.len() == 0
    }

    /// A number between the two.
    fn tame(&mut self, low: f32, high: f32) -> f32 {
        let word = u16::from_be_bytes([self.byte(), self.byte()]);
        low + (high - low) * f32::from(word) / f32::from(u16::MAX)
    }

    /// Mostly a number between the two.
    fn value(&mut self, low: f32, high: f32) -> f32 {
        match self.byte() {
            tag @ 240.. => WILD[usize::from(tag - 240)],
            tag => low + (high - low) * (f32::from(tag) + self.tame(0.0, 1.0)) / 240.0,
        }
    }

    fn values<const N: usize>(&mut self, low: f32, high: f32) -> [f32; N] {
        std::array::from_fn(|_| self.value(low, high))
    }
}

/// The scene and the camera that these bytes are.
pub fn scene_from_bytes(bytes: &[u8]) -> (HostGaussians, Camera) {
    let mut reader = Reader(bytes.iter());
    let camera = camera(&mut reader);
    let mut scene = HostGaussians {
        means: Vec::new(),
        color: HostHead { channels: 3, ..HostHead::default() },
        language: HostHead { channels: CHANNELS, ..HostHead::default() },
    };
    while !reader.is_empty() && scene.len() < MOST {
        // Means before the camera are of more interest than others; a pose that is not finite is
        // refused anyway.
        let [u, v] = reader.values(-0.2, 1.2);
        let depth = reader.value(-0.2, 5.0);
        let (u, v) = (u * camera.width as f32, v * camera.height as f32);
        scene.means.push(camera.unproject(u, v, depth).into());
        for head in [&mut scene.color, &mut scene.language] {
            head.rotations.push(reader.values(-1.0, 1.0));
            head.log_scales.push(reader.values(-6.0, 1.0));
            head.opacity_logits.push(reader.value(-6.0, 6.0));
            for _ in 0..head.channels {
                let feature = reader.value(-1.0, 1.0);
                head.features.push(if feature.abs() < 1e30 { feature } else { 0.0 });
            }
        }
    }
    (scene, camera)
}

/// One camera in four has wild values.
fn camera(reader: &mut Reader<'_>) -> Camera {
    let wild = reader.byte().is_multiple_of(4);
    let mut value = |low, high| if wild { reader.value(low, high) } else { reader.tame(low, high) };
    let (fx, fy) = (value(5.0, 60.0), value(5.0, 60.0));
    let (cx, cy) = (value(0.0, 40.0), value(0.0, 40.0));
    let [w, i, j, k] = std::array::from_fn(|_| value(-0.2, 0.2));
    let translation = Translation3::new(value(-1.0, 1.0), value(-1.0, 1.0), value(-1.0, 1.0));
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(1.0 + w, i, j, k));
    let (width, height) = (reader.byte() % (SIDE + 1), reader.byte() % (SIDE + 1));
    Camera {
        width: u32::from(width),
        height: u32::from(height),
        fx,
        fy,
        cx,
        cy,
        camera_from_world: Isometry3::from_parts(translation, rotation),
    }
}

fn is_usable(camera: &Camera) -> bool {
    let pose = camera.camera_from_world.to_homogeneous();
    let focal = [camera.fx, camera.fy];
    let finite = pose.iter().chain(&[camera.cx, camera.cy]).chain(&focal).all(|v| v.is_finite());
    finite && focal.iter().all(|f| *f > 0.0) && camera.width > 0 && camera.height > 0
}

/// Everything that must hold, whatever the bytes: no panic; no error but that for a camera that
/// cannot be used; no value in a picture that is not finite; opacities and shares in [0, 1]; a
/// step leaves every finite parameter finite; and the picture after it is as good.
pub fn hold(gpu: &Gpu, trainer: &mut Trainer, bytes: &[u8]) -> Outcome {
    let (scene, camera) = scene_from_bytes(bytes);
    let mut map = Gaussians::new(gpu, CHANNELS);
    map.append(&scene).expect("shapes agree");
    let first = trainer.renderer().render_color(&map, &camera);
    if !is_usable(&camera) {
        let error = first.expect_err("the camera cannot be used");
        assert!(matches!(error, GpuError::BadValue { what: "camera", .. }), "{error}");
        return Outcome::Refused;
    }
    first.unwrap_or_else(|error| panic!("{error} with {camera:?}"));
    let drawn = check_pictures(trainer.renderer(), &map, &camera, "before the step");
    step(gpu, trainer, &mut map, &camera);
    let after = map.to_host().expect("reads");
    for (name, before, after) in pairs(&scene, &after) {
        let kept = before.iter().zip(&after).all(|(b, a)| !b.is_finite() || a.is_finite());
        assert!(kept, "{name}: a step made {before:?} into {after:?}");
    }
    check_pictures(trainer.renderer(), &map, &camera, "after the step");
    if drawn { Outcome::Drawn } else { Outcome::Empty }
}

/// True if there is anything in the picture.
fn check_pictures(renderer: &mut Renderer, map: &Gaussians, camera: &Camera, when: &str) -> bool {
    let color = renderer.render_color(map, camera).expect("it did before");
    let contributions = renderer.contributions(map, camera).expect("renders");
    let share = |value: f32| value / camera.pixels() as f32;
    let weights: Vec<f32> = contributions.iter().map(|given| share(given.weight)).collect();
    let touched: Vec<f32> = contributions.iter().map(|given| share(given.touched_pixels)).collect();
    let language = renderer.render_language(map, camera).expect("renders");
    let finite = |what: &str, values: &[f32]| {
        let found = values.iter().find(|value| !value.is_finite());
        assert!(found.is_none(), "{what} {when}: {found:?}");
    };
    finite("rgb", &color.rgb);
    finite("depth", &color.depth);
    finite("codes", &language.codes);
    for (what, values) in [
        ("opacity", &color.opacity),
        ("language opacity", &language.opacity),
        ("share of the light", &weights),
        ("share of the pixels", &touched),
    ] {
        let found = values.iter().find(|value| !(0.0..=1.0).contains(*value));
        assert!(found.is_none(), "{what} {when}: {found:?}");
    }
    color.opacity.iter().any(|opacity| *opacity > 0.0)
}

fn step(gpu: &Gpu, trainer: &mut Trainer, map: &mut Gaussians, camera: &Camera) {
    let pixels = camera.pixels();
    let size = (camera.width, camera.height);
    let color = ColorTarget::new(gpu, size.0, size.1, &vec![128; 3 * pixels], &vec![1.0; pixels]);
    let codes = vec![0.5; CHANNELS * pixels];
    let language = LanguageTarget::new(gpu, size.0, size.1, CHANNELS, &codes);
    let (color, language) = (color.expect("fits"), language.expect("fits"));
    let view = TrainingView {
        camera,
        color: Some(&color),
        language: Some((camera, &language)),
        exposure: [0.1, -0.05],
        focus: None,
    };
    let (weights, rates) = (LossWeights::default(), LearningRates::default());
    trainer.step(map, &view, &weights, &rates).expect("the camera can be used");
    let losses = trainer.last_report(map).expect("settles").losses;
    let all = [losses.color, losses.depth, losses.language, losses.isotropic, losses.tie];
    assert!(all.iter().all(|loss| loss.is_finite() && *loss >= 0.0), "{losses:?}");
}

/// Every array of parameters of two maps, by name.
fn pairs(a: &HostGaussians, b: &HostGaussians) -> Vec<(&'static str, Vec<f32>, Vec<f32>)> {
    let mut all = vec![("mean", a.means.concat(), b.means.concat())];
    for (a, b) in [(&a.color, &b.color), (&a.language, &b.language)] {
        all.push(("rotation", a.rotations.concat(), b.rotations.concat()));
        all.push(("log scale", a.log_scales.concat(), b.log_scales.concat()));
        all.push(("opacity logit", a.opacity_logits.clone(), b.opacity_logits.clone()));
        all.push(("feature", a.features.clone(), b.features.clone()));
    }
    all
}
