//! Dot products of many features with a few words.
//!
//! A matrix product would first copy every feature into the order that its kernel likes; with a handful of
//! words that copy is four fifths of the work (profiled: 41 % of a 3D question against 8 % for the kernel).
//! Here a feature is read once, while it is in the cache, for all words.

use ndarray::Array2;

/// Sums that run side by side: as many as the widest registers hold.
const LANES: usize = 16;

/// `[n, words]` of features `[n, D]` and words `[words, D]`.
pub(super) fn cosines(features: &[f32], words: &Array2<f32>) -> Vec<f32> {
    let size = words.ncols();
    assert_eq!(features.len() % size, 0, "features are of the words' size");
    let words = words.as_slice().expect("rows were pushed one after the other");
    let mut found = Vec::with_capacity(features.len() / size * (words.len() / size));
    for feature in features.chunks_exact(size) {
        for word in words.chunks_exact(size) {
            found.push(dot(feature, word));
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
        assert!(cosines(&[], &words).is_empty());
    }
}
