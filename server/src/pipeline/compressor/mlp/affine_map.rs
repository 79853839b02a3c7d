//! Affine map from an old to a new code space: c_new = A c_old + b, by least squares over samples.
//!
//! In: old and new codes `[n, k]` of the same samples, unit length. Out: a map for codes of any
//! length. It preserves lengths, because a blended code is shorter than its parts.

use nalgebra::{DMatrix, DVector};

/// Ridge regularisation for directions without samples, relative to the samples' mean square.
const RIDGE: f64 = 1e-6;
/// Codes shorter than this have no direction and stay as they are.
const MIN_LENGTH: f64 = 1e-6;

/// An affine map between two code spaces of size k.
pub(super) struct AffineMap {
    /// `[k, k + 1]`: A, then b.
    matrix: DMatrix<f64>,
}

impl AffineMap {
    /// The least-squares map; `None` if the samples do not determine one.
    pub(super) fn fit(size: usize, from: &[f32], to: &[f32]) -> Option<Self> {
        let mut squares = DMatrix::<f64>::zeros(size + 1, size + 1);
        let mut products = DMatrix::<f64>::zeros(size + 1, size);
        for (from, to) in from.chunks_exact(size).zip(to.chunks_exact(size)) {
            let from = extended(from, 1.0);
            let to = DVector::from_iterator(size, to.iter().map(|&value| f64::from(value)));
            squares.ger(1.0, &from, &from, 1.0);
            products.ger(1.0, &from, &to, 1.0);
        }
        let ridge = RIDGE * squares.trace() / (size + 1) as f64;
        let squares = squares + DMatrix::identity(size + 1, size + 1) * ridge;
        let solved = squares.cholesky()?.solve(&products);
        solved.iter().all(|value| value.is_finite()).then(|| Self { matrix: solved.transpose() })
    }

    /// Maps codes `[n, k]`; each keeps its length.
    pub(super) fn apply(&self, codes: &[f32]) -> Vec<f32> {
        let size = self.matrix.nrows();
        let mut found = Vec::with_capacity(codes.len());
        for code in codes.chunks_exact(size) {
            let length = code.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
            let moved = &self.matrix * extended(code, length);
            let moved_length = moved.norm();
            if length > MIN_LENGTH && moved_length > MIN_LENGTH {
                let scale = length / moved_length;
                found.extend(moved.iter().map(|value| (value * scale) as f32));
            } else {
                found.extend_from_slice(code);
            }
        }
        found
    }
}

/// A code with one more entry. With the code's length as that entry, the map is homogeneous: a
/// scaled code has the scaled image.
fn extended(code: &[f32], last: f64) -> DVector<f64> {
    let values = code.iter().map(|&value| f64::from(value)).chain([last]);
    DVector::from_iterator(code.len() + 1, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four directions on a circle, and the same ones rotated by 90 degrees.
    const FROM: [f32; 8] = [1.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.6, 0.8];
    const TO: [f32; 8] = [0.0, 1.0, -1.0, 0.0, 0.0, -1.0, -0.8, 0.6];

    #[test]
    fn a_rotation_is_recovered_and_lengths_are_kept() {
        let map = AffineMap::fit(2, &FROM, &TO).expect("four samples are enough");
        let moved = map.apply(&[0.3, 0.0, 0.0, 2.0, 0.0, 0.0]);
        for (found, expected) in moved.iter().zip([0.0, 0.3, -2.0, 0.0, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-3, "{moved:?}");
        }
        // Negative control: unchanged samples give the identity.
        let still = AffineMap::fit(2, &FROM, &FROM).expect("four samples are enough");
        assert!((still.apply(&[0.3, 0.0])[0] - 0.3).abs() < 1e-3);
    }

    #[test]
    fn without_samples_there_is_no_map() {
        assert!(AffineMap::fit(2, &[], &[]).is_none());
    }
}
