//! Binary descriptors of the surroundings of a corner.

use crate::grey::Grey;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

/// Bits of a descriptor.
const BITS: usize = 256;
/// Radius of the described surface, metres,
const RADIUS_METRES: f32 = 0.12;
/// which is at least and at most this many pixels.
const RADIUS_PIXELS: (f32, f32) = (7.0, 28.0);
/// Seed of the compared points.
const SEED: u64 = 0xb1ef;

/// Pairs of points in the unit circle that are compared, denser in the middle.
static PAIRS: LazyLock<Vec<[[f32; 2]; 2]>> = LazyLock::new(|| {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut point = || loop {
        // The sum of three numbers is close to a normal distribution.
        let place = [(); 2].map(|()| (0..3).map(|_| rng.random_range(-0.5..0.5f32)).sum::<f32>());
        if place[0] * place[0] + place[1] * place[1] <= 1.0 {
            return place;
        }
    };
    (0..BITS).map(|_| [point(), point()]).collect()
});

/// One bit for each pair of points: whether the first is darker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Descriptor([u64; BITS / 64]);

impl Descriptor {
    /// Describes the surroundings of a pixel in a smoothed image.
    pub fn new(image: &Grey, column: usize, row: usize, radius: f32) -> Self {
        let value =
            |[x, y]: [f32; 2]| image.at(column as f32 + radius * x, row as f32 + radius * y);
        let mut bits = [0; BITS / 64];
        for (bit, [first, second]) in PAIRS.iter().enumerate() {
            bits[bit / 64] |= u64::from(value(*first) < value(*second)) << (bit % 64);
        }
        Self(bits)
    }

    /// The number of bits that differ.
    pub fn distance(&self, other: &Self) -> u32 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a ^ b).count_ones()).sum()
    }
}

/// Radius of the described pixels for a focal length in pixels and a depth in metres.
pub(crate) fn radius(focal: f32, depth: f32) -> f32 {
    (RADIUS_METRES * focal / depth).clamp(RADIUS_PIXELS.0, RADIUS_PIXELS.1)
}
