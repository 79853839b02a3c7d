//! The seeded random source of a room: ranges, choices and palettes.

use crate::material::Texture;
use crate::vector::rgb;
use glam::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A room's random numbers.
pub(crate) struct Dice(ChaCha8Rng);

const WOODS: [(u32, u32); 6] = [
    (0xc8975a, 0x8f5e2e),
    (0xd9b98a, 0xb08a58),
    (0x8a5a34, 0x4f2f18),
    (0x5c3a24, 0x33200f),
    (0xe2d2b4, 0xc0a67c),
    (0xa8663a, 0x6e3a1c),
];
const FABRICS: [u32; 10] = [
    0x5b7a94, 0x8c4a3c, 0x55704f, 0xb8a488, 0x6a5a7c, 0xc08a3c, 0x3e5568, 0xa85a6a, 0x7d8a90,
    0x4a6a6a,
];
const BRIGHTS: [u32; 10] = [
    0xc83228, 0x2864b4, 0xe8b41e, 0x2e8c50, 0xe07828, 0x7a3c96, 0x1e96a0, 0xd65a8c, 0x283c64,
    0xf0ebe0,
];

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        self.0.random_range(low..high)
    }

    pub fn count(&mut self, low: usize, high: usize) -> usize {
        self.0.random_range(low..=high)
    }

    pub fn chance(&mut self, probability: f32) -> bool {
        self.between(0.0, 1.0) < probability
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.0.random_range(0..from.len())]
    }

    /// A variation number for prints and ornaments.
    pub fn variant(&mut self) -> u32 {
        self.0.random_range(0..100_000)
    }

    pub fn bright(&mut self) -> Vec3 {
        rgb(self.pick(&BRIGHTS))
    }

    pub fn fabric_color(&mut self) -> Vec3 {
        rgb(self.pick(&FABRICS))
    }

    /// A kind of wood with its grain along x, y or z of the object.
    pub fn wood(&mut self) -> Wood {
        let (base, dark) = self.pick(&WOODS);
        Wood { base: rgb(base), dark: rgb(dark) }
    }

    /// Upholstery: woven, plaid, striped or leather.
    pub fn upholstery(&mut self) -> Texture {
        let a = self.fabric_color();
        match self.count(0, 4) {
            0 => Texture::Leather(rgb(self.pick(&[0x6b3e26, 0x3a2a22, 0x8a6a4a, 0x2c3238]))),
            1 => Texture::Plaid { ground: a, band: a * 0.35 },
            _ => Texture::Weave { a, b: a * 0.62 },
        }
    }

    /// A lively cloth for cushions and covers.
    pub fn cloth(&mut self) -> Texture {
        let (a, b) = (self.bright(), rgb(0xf0ebe0));
        match self.count(0, 3) {
            0 => Texture::Stripes { a, b, period: 0.09 },
            1 => Texture::Dots { ground: a, dot: b, period: 0.08 },
            2 => Texture::Plaid { ground: b, band: a },
            _ => Texture::Weave { a, b: a * 0.6 },
        }
    }
}

/// The two colors of a wood.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wood {
    base: Vec3,
    dark: Vec3,
}

impl Wood {
    pub fn along(self, axis: usize) -> Texture {
        Texture::Wood { base: self.base, dark: self.dark, axis }
    }

    pub fn planks(self) -> Texture {
        Texture::Planks { base: self.base, dark: self.dark }
    }
}
