//! Random numbers of a frame: the same for the same seed, frame and purpose, whatever else is drawn.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f32::consts::TAU;

/// What numbers are for; each purpose has a stream of its own.
#[derive(Clone, Copy, Debug)]
pub(super) enum Purpose {
    Axial,
    Columns,
    Rows,
    Flying,
    Holes,
    Light,
}

/// The random source of one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    pub seed: u64,
    pub frame: u64,
}

impl Noise {
    fn stream(self, purpose: Purpose) -> ChaCha8Rng {
        let mixed = self.seed ^ self.frame.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut random = ChaCha8Rng::seed_from_u64(mixed);
        random.set_stream(purpose as u64);
        random
    }

    /// Numbers of 0 to 1.
    pub fn uniform(self, purpose: Purpose, count: usize) -> Vec<f32> {
        let mut random = self.stream(purpose);
        (0..count).map(|_| random.random_range(0.0..1.0)).collect()
    }

    /// Independent numbers of mean 0 and variance 1 (Box and Muller).
    pub fn normal(self, purpose: Purpose, count: usize) -> Vec<f32> {
        let mut random = self.stream(purpose);
        let mut pair = || {
            let (u, v): (f32, f32) = (random.random_range(0.0..1.0), random.random_range(0.0..1.0));
            let radius = (-2.0 * (1.0 - u).ln()).sqrt();
            [radius * (TAU * v).cos(), radius * (TAU * v).sin()]
        };
        let mut numbers: Vec<f32> = (0..count.div_ceil(2)).flat_map(|_| pair()).collect();
        numbers.truncate(count);
        numbers
    }

    /// A field of mean 0 and variance 1 in which pixels up to twice `reach` apart are correlated.
    pub fn field(self, purpose: Purpose, width: usize, height: usize, reach: f32) -> Vec<f32> {
        let white = self.normal(purpose, width * height);
        let reach = reach.round() as usize;
        if reach == 0 {
            return white;
        }
        let rows = summed(&white, width, reach);
        let columns = summed(&transposed(&rows, width), height, reach);
        transposed(&columns, height)
    }
}

/// The sum over neighbours in the row with the weights of a triangle, scaled to variance 1. In rows
/// and columns this is nearly round; equal weights would look woven.
fn summed(values: &[f32], width: usize, reach: usize) -> Vec<f32> {
    let mut sums = Vec::with_capacity(values.len());
    for row in values.chunks_exact(width) {
        sums.extend((0..width).map(|x| {
            let (mut sum, mut squares) = (0.0, 0.0);
            let first = x.saturating_sub(reach);
            for (i, value) in row[first..(x + reach + 1).min(width)].iter().enumerate() {
                let weight = (reach + 1 - x.abs_diff(first + i)) as f32;
                (sum, squares) = (sum + weight * value, squares + weight * weight);
            }
            sum / squares.sqrt()
        }));
    }
    sums
}

fn transposed(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width;
    (0..values.len()).map(|i| values[i % height * width + i / height]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deviation(values: &[f32]) -> f32 {
        (values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32).sqrt()
    }

    /// Correlation of neighbours in a row and in a column.
    fn correlations(field: &[f32], width: usize) -> [f32; 2] {
        [1, width].map(|step| {
            let products = field.iter().zip(&field[step..]).map(|(a, b)| a * b);
            products.sum::<f32>() / (field.len() - step) as f32
        })
    }

    #[test]
    fn fields_have_variance_1_and_the_correlation_that_is_asked_for() {
        let noise = Noise { seed: 1, frame: 4 };
        let (width, height) = (200, 150);
        for (reach, expected) in [(0.0, 0.0), (2.0, 0.84)] {
            let field = noise.field(Purpose::Axial, width, height, reach);
            assert!((deviation(&field) - 1.0).abs() < 0.05, "{}", deviation(&field));
            for found in correlations(&field, width) {
                assert!((found - expected).abs() < 0.06, "{found} for a reach of {reach}");
            }
        }
    }

    #[test]
    fn numbers_depend_on_seed_frame_and_purpose() {
        let noise = Noise { seed: 1, frame: 4 };
        let numbers = |noise: Noise, purpose| noise.normal(purpose, 9);
        let first = numbers(noise, Purpose::Axial);
        assert_eq!(first, numbers(noise, Purpose::Axial));
        assert_ne!(first, numbers(noise, Purpose::Rows));
        assert_ne!(first, numbers(Noise { frame: 5, ..noise }, Purpose::Axial));
        assert_ne!(first, numbers(Noise { seed: 2, ..noise }, Purpose::Axial));
    }
}
