//! Dot products of many features with a few words.
//!
//! A matrix product would first copy every feature into the order that its kernel likes; with a handful of
//! words that copy is four fifths of the work (profiled: 41 % of a 3D question against 8 % for the kernel).
//! Here a feature is read once, while it is in the cache, for all words. What then limits is memory: features
//! that are kept are kept as bf16, half the bytes, which moves a cosine by less than 0.001.

use half::bf16;
use ndarray::Array2;

/// Sums that run side by side: as many as the widest registers hold.
const LANES: usize = 16;

/// A number of a feature, as it is kept.
pub(super) trait Component: Copy + Sync {
    /// As it is computed with.
    fn wide(self) -> f32;
}

impl Component for f32 {
    fn wide(self) -> f32 {
        self
    }
}

impl Component for bf16 {
    fn wide(self) -> f32 {
        // Features are finite: no need for `to_f32`'s look for NaN.
        f32::from_bits(u32::from(self.to_bits()) << 16)
    }
}

/// Features to keep.
pub(super) fn kept(features: &[f32]) -> impl Iterator<Item = bf16> {
    features.iter().copied().map(bf16::from_f32)
}

/// `[n, words]` of features `[n, D]` and words `[words, D]`.
pub(super) fn cosines<T: Component>(features: &[T], words: &Array2<f32>) -> Vec<f32> {
    let size = words.ncols();
    assert_eq!(features.len() % size, 0, "features are of the words' size");
    let words = words.as_slice().expect("rows were pushed one after the other");
    let mut found = Vec::with_capacity(features.len() / size * (words.len() / size));
    let mut wide = vec![0.0; size];
    for feature in features.chunks_exact(size) {
        wide.iter_mut().zip(feature).for_each(|(wide, value)| *wide = value.wide());
        for word in words.chunks_exact(size) {
            found.push(dot(&wide, word));
        }
    }
    found
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a_blocks, a_rest) = a.as_chunks::<LANES>();
    let (b_blocks, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let rest = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::ArrayView2;

    #[test]
    fn they_are_the_matrix_product() {
        // Two blocks and a rest.
        let size = 2 * LANES + 5;
        let value = |i: usize, step: usize| ((i * step % 17) as f32 - 8.0) / 9.0;
        let features: Vec<f32> = (0..7 * size).map(|i| value(i, 5)).collect();
        let words = Array2::from_shape_fn((3, size), |(row, column)| value(row * size + column, 3));
        let rows = ArrayView2::from_shape((7, size), &features).unwrap();
        let expected = rows.dot(&words.t());
        let found = cosines(&features, &words);
        assert_eq!(found.len(), 7 * 3);
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-4, "{found} {expected}");
        }
        // Negative control: another word is another number.
        assert!((found[0] - expected[[0, 1]]).abs() > 1e-2);
        assert!(cosines::<f32>(&[], &words).is_empty());
    }

    #[test]
    fn what_is_kept_is_near_enough() {
        let size = 384;
        let unit = |seed: usize| {
            let values: Vec<f32> = (0..size).map(|i| ((i * i + seed) as f32).sin()).collect();
            let length = values.iter().map(|v| v * v).sum::<f32>().sqrt();
            values.into_iter().map(|value| value / length).collect::<Vec<f32>>()
        };
        let features: Vec<f32> = (0..200).flat_map(unit).collect();
        let words = Array2::from_shape_vec((2, size), [unit(3), unit(300)].concat()).unwrap();
        let small: Vec<bf16> = kept(&features).collect();
        let apart = cosines(&features, &words)
            .iter()
            .zip(cosines(&small, &words))
            .map(|(exact, found)| (exact - found).abs())
            .fold(0.0_f32, f32::max);
        // Worst seen 0.0004.
        assert!(apart < 1e-3, "{apart}");
        // Negative control: they are not the same numbers.
        assert!(apart > 0.0);
    }
}
