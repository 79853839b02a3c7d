//! The work of the probe, in three parts that stand for what a server spends its time with. It is
//! fixed: a change of it makes times of different versions incomparable, and needs a new reference.
//!
//! - [`Sweep`]: 64 MiB are copied four times, which is more than the caches hold.
//! - [`Blend`]: Gaussians are blended front to back at the pixels of a small picture, with plain
//!   loops on the processor. It stands for the renderer, which the server runs in a graphics driver:
//!   the driver's own kernel would be another one in another build, and the probe must stay the same.
//! - [`Product`]: a product of two matrices in ONNX Runtime.
//!
//! Each part uses all cores. Copy and product are the same machine code in every build; the loop is
//! written so that optimisers have little to gain.

use crate::runtime;
use ort::session::Session;
use ort::value::TensorRef;
use rayon::prelude::*;

const SWEEP_WORDS: usize = 8 << 20;
const SWEEPS: usize = 4;
/// Words that a thread copies at a time.
const SWEEP_PART: usize = 1 << 17;

/// Four copies of 64 MiB.
pub(super) struct Sweep {
    from: Vec<u64>,
    to: Vec<u64>,
}

impl Sweep {
    pub(super) fn new() -> Self {
        // Values other than zero, so that every page is there.
        Self { from: vec![1; SWEEP_WORDS], to: vec![2; SWEEP_WORDS] }
    }

    pub(super) fn run(&mut self) {
        for _ in 0..SWEEPS {
            let parts = self.to.par_chunks_mut(SWEEP_PART).zip(self.from.par_chunks(SWEEP_PART));
            parts.for_each(|(to, from)| to.copy_from_slice(from));
            std::hint::black_box(&self.to);
        }
    }
}

/// Side of a tile, pixels.
const TILE: usize = 16;
const TILES: usize = 96;
const SPLATS: usize = 128;
/// A pixel with less of its light left is full.
const FULL: f32 = 1e-4;

/// A Gaussian on the picture: centre (pixels of its tile), inverse covariance, opacity, color.
#[derive(Clone, Copy)]
struct Splat {
    center: [f32; 2],
    conic: [f32; 3],
    opacity: f32,
    color: [f32; 3],
}

/// The blend of 96 tiles of 16x16 pixels, with 128 Gaussians each.
pub(super) struct Blend {
    tiles: Vec<Vec<Splat>>,
}

impl Blend {
    /// A scene of random Gaussians; the probe's is that of seed 1.
    pub(super) fn new(seed: u32) -> Self {
        let mut dice = Dice(seed);
        let mut tile = || (0..SPLATS).map(|_| dice.splat()).collect();
        Self { tiles: (0..TILES).map(|_| tile()).collect() }
    }

    /// The sum of all colors.
    pub(super) fn run(&self) -> f32 {
        let sums: Vec<f32> = self.tiles.par_iter().map(|splats| tile_sum(splats)).collect();
        std::hint::black_box(sums.iter().sum())
    }
}

fn tile_sum(splats: &[Splat]) -> f32 {
    let mut sum = 0.0;
    for pixel in 0..TILE * TILE {
        let at = [(pixel % TILE) as f32 + 0.5, (pixel / TILE) as f32 + 0.5];
        sum += blended(splats, at).iter().sum::<f32>();
    }
    sum
}

/// The color of a pixel: C = sum of c α T, with T the light that the Gaussians before it let through.
fn blended(splats: &[Splat], at: [f32; 2]) -> [f32; 3] {
    let (mut color, mut light) = ([0.0; 3], 1.0);
    for splat in splats {
        let (dx, dy) = (at[0] - splat.center[0], at[1] - splat.center[1]);
        let [a, b, c] = splat.conic;
        let power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy;
        let alpha = splat.opacity * power.exp();
        let weight = alpha * light;
        let [red, green, blue] = splat.color;
        color = [color[0] + red * weight, color[1] + green * weight, color[2] + blue * weight];
        light *= 1.0 - alpha;
        if light < FULL {
            break;
        }
    }
    color
}

/// A linear congruential generator (Numerical Recipes): the same numbers everywhere.
struct Dice(u32);

impl Dice {
    fn between(&mut self, least: f32, most: f32) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let share = (self.0 >> 8) as f32 / (1 << 24) as f32;
        least + share * (most - least)
    }

    fn splat(&mut self) -> Splat {
        let mut inside = || self.between(0.0, TILE as f32);
        let center = [inside(), inside()];
        let mut narrow = || self.between(0.02, 0.2);
        let (a, c) = (narrow(), narrow());
        // Less than the square root of `a c`, so that it is a Gaussian.
        let b = self.between(-0.5, 0.5) * a.min(c);
        let mut channel = || self.between(0.0, 1.0);
        let color = [channel(), channel(), channel()];
        Splat { center, conic: [a, b, c], opacity: self.between(0.02, 0.4), color }
    }
}

/// Rows and columns of the matrices, as `product.onnx` has them.
const SIDE: usize = 1536;

/// A network of one operation, `MatMul` of two matrices of 1536x1536.
pub(super) struct Product {
    session: Session,
    matrix: Vec<f32>,
}

impl Product {
    /// Loads ONNX Runtime; else says why it is not there.
    pub(super) fn open() -> Result<Self, String> {
        let missing = || {
            let variable = runtime::RUNTIME_VARIABLE;
            format!("ONNX Runtime was not found: run `make deps`, or set {variable}")
        };
        let library = runtime::library().ok_or_else(missing)?;
        let environment = runtime::environment(&library)?;
        let session = Self::session(&environment).map_err(|error| error.to_string())?;
        Ok(Self { session, matrix: vec![0.5; SIDE * SIDE] })
    }

    fn session(environment: &ort::environment::Environment) -> ort::Result<Session> {
        // Idle threads must not spin: other parts of the probe are timed.
        let builder = Session::builder(environment)?.with_intra_op_spinning(false)?;
        let mut builder = builder;
        builder.commit_from_memory(include_bytes!("product.onnx"))
    }

    /// The first number of the product.
    pub(super) fn run(&mut self) -> Result<f32, String> {
        self.multiplied().map_err(|error| error.to_string())
    }

    fn multiplied(&mut self) -> ort::Result<f32> {
        let tensor = || TensorRef::from_array_view(([SIDE, SIDE], &self.matrix[..]));
        let (first, second) = (tensor()?, tensor()?);
        let outputs = self.session.run(ort::inputs![first, second])?;
        let (_, numbers) = outputs[0].try_extract_tensor::<f32>()?;
        Ok(numbers[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_copy_copies() {
        let mut sweep = Sweep::new();
        assert_ne!(sweep.to, sweep.from);
        sweep.run();
        assert_eq!(sweep.to, sweep.from);
        assert_eq!(std::mem::size_of_val(&sweep.from[..]), 64 << 20);
    }

    #[test]
    fn the_blend_is_always_the_same_work() {
        let sum = Blend::new(1).run();
        assert_eq!(sum, Blend::new(1).run());
        assert!((sum - BLEND_SUM).abs() < 1.0, "{sum}: other work than the reference's");
        let other = Blend::new(2).run();
        assert!((other - BLEND_SUM).abs() > 10.0, "{other}");
    }

    /// On x86-64; `exp` may differ in the last bit elsewhere.
    const BLEND_SUM: f32 = 36410.477;

    #[test]
    fn a_gaussian_hides_what_is_behind_it() {
        let splat =
            |opacity, color| Splat { center: [4.0; 2], conic: [0.1, 0.0, 0.1], opacity, color };
        let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let [r, _, b] = blended(&[splat(0.75, red), splat(0.5, blue)], [4.0; 2]);
        assert_eq!([r, b], [0.75, 0.125]);
        let aside = blended(&[splat(0.75, red)], [6.0, 4.0]);
        assert!((aside[0] - 0.75 * (-0.2_f32).exp()).abs() < 1e-6, "{aside:?}");
        assert_eq!(blended(&[splat(1.0, red), splat(1.0, blue)], [4.0; 2])[2], 0.0);
    }

    #[test]
    fn the_product_is_one() {
        let mut product = Product::open().expect("`make deps` was run");
        // 1536 times 0.5².
        assert_eq!(product.run(), Ok(384.0));
    }
}
