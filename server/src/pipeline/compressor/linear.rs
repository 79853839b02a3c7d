//! Linear online stage: the leading eigenvectors of the second moments of all observed codes, and a
//! dictionary for the part of codes that they do not span.
//!
//! Encoding is `c = W g`, with orthonormal rows W `[code_size, 32]`. Decoding is the direction of
//! `Wᵀ c + r(c)`, where the remainder r is looked up in the [`Dictionary`]. A small basis keeps
//! little of rare directions, but enough to identify them in the dictionary.
//!
//! Alpha blending is a weighted sum and commutes with W, so a blended code decodes to the blend of
//! the codes. The moments are sums over all keyframes with equal weights, so none is forgotten.
//! When the basis is replaced, the new one is rotated within its span to change codes as little as
//! possible.

use super::dictionary::{Dictionary, DictionaryDecoder};
use super::online_stage::OnlineStage;
use super::rows::normalise_rows;
use crate::pipeline::network::GENERIC_SIZE;
use crate::pipeline::saving::packed;
use nalgebra::{DMatrix, SMatrix, SVector, SymmetricEigen};
use ndarray::{Array2, Axis};
use serde::{Deserialize, Serialize};

type Moments = SMatrix<f64, GENERIC_SIZE, GENERIC_SIZE>;
type Code = SVector<f64, GENERIC_SIZE>;

/// Rows that are summed in single precision, before their sum is added in double precision.
const BLOCK: usize = 512;

/// Running principal directions of all observed codes.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Linear {
    code_size: usize,
    tolerance: f64,
    version: u64,
    keyframes: u64,
    /// Sum over keyframes of the mean of g gᵀ.
    moments: Moments,
    /// `[code_size, 32]`, orthonormal rows.
    #[serde(with = "packed")]
    basis: Vec<f32>,
    dictionary: Dictionary,
    #[serde(skip)]
    decoder: DictionaryDecoder,
}

impl Linear {
    /// The state before any keyframe: the basis is the first axes. `tolerance` is the share of all
    /// observed codes' squared length that the basis may lose, beyond what the best basis loses,
    /// before it is replaced.
    pub(super) fn new(code_size: usize, tolerance: f64) -> Self {
        let mut basis = vec![0.0; code_size * GENERIC_SIZE];
        for axis in 0..code_size {
            basis[axis * GENERIC_SIZE + axis] = 1.0;
        }
        let dictionary = Dictionary::default();
        Self {
            code_size,
            tolerance,
            version: 0,
            keyframes: 0,
            moments: Moments::zeros(),
            decoder: dictionary.decoder(&basis),
            basis,
            dictionary,
        }
    }

    /// Makes what is not saved; `None` if the parts do not fit together.
    pub(super) fn restored(mut self) -> Option<Self> {
        if self.basis.len() != self.code_size * GENERIC_SIZE || !self.dictionary.is_whole() {
            return None;
        }
        self.decoder = self.dictionary.decoder(&self.basis);
        Some(self)
    }

    /// Squared length that a basis keeps, summed over the moments.
    fn kept(&self, basis: &[f32]) -> f64 {
        let row_kept = |row: &[f32]| {
            let row = Code::from_iterator(row.iter().map(|&v| v.into()));
            row.dot(&(self.moments * row))
        };
        basis.chunks_exact(GENERIC_SIZE).map(row_kept).sum()
    }
}

impl OnlineStage for Linear {
    fn code_size(&self) -> usize {
        self.code_size
    }

    fn version(&self) -> u64 {
        self.version
    }

    fn observe(&mut self, generic: &[f32]) -> bool {
        let rows = directions(generic);
        if rows.is_empty() {
            return false;
        }
        self.moments += mean_outer_product(&rows);
        self.keyframes += 1;
        self.dictionary.observe(&rows);
        let best = principal_rows(self.moments, self.code_size);
        let lost = self.kept(&best) - self.kept(&self.basis);
        let replaced = self.version == 0 || lost > self.tolerance * self.keyframes as f64;
        if replaced {
            self.basis = if self.version == 0 { best } else { rotated_towards(&self.basis, &best) };
            self.version += 1;
        }
        self.decoder = self.dictionary.decoder(&self.basis);
        replaced
    }

    fn encode(&self, generic: &[f32]) -> Vec<f32> {
        let mut codes = Vec::with_capacity(generic.len() / GENERIC_SIZE * self.code_size);
        for row in generic.chunks_exact(GENERIC_SIZE) {
            for direction in self.basis.chunks_exact(GENERIC_SIZE) {
                codes.push(row.iter().zip(direction).map(|(a, b)| a * b).sum());
            }
        }
        codes
    }

    fn decode(&self, codes: &[f32]) -> Vec<f32> {
        let mut generic = self.decoder.decode(codes);
        normalise_rows(&mut generic, GENERIC_SIZE);
        generic
    }

    fn save(&self) -> Vec<u8> {
        rmp_serde::to_vec_named(self).expect("numbers can be written")
    }

    fn boxed_clone(&self) -> Box<dyn OnlineStage> {
        Box::new(self.clone())
    }
}

/// The basis with the span of `new` that is nearest to `old` (orthogonal Procrustes, Schönemann
/// 1966). Codes, and an optimiser's moments of them, change as little as possible.
fn rotated_towards(old: &[f32], new: &[f32]) -> Vec<f32> {
    let rows =
        |basis: &[f32]| DMatrix::from_row_slice(basis.len() / GENERIC_SIZE, GENERIC_SIZE, basis);
    let (old, new) = (rows(old), rows(new));
    let svd = (&old * new.transpose()).svd(true, true);
    let (left, right) = svd.u.zip(svd.v_t).expect("both factors were requested");
    (left * right * new).transpose().as_slice().to_vec()
}

/// The rows of non-zero length, scaled to unit length, `[n, 32]`.
fn directions(generic: &[f32]) -> Array2<f32> {
    let mut rows = Vec::with_capacity(generic.len());
    for row in generic.chunks_exact(GENERIC_SIZE) {
        let squared = row.iter().map(|value| value * value).sum::<f32>();
        if squared.is_finite() && squared > 0.0 {
            rows.extend(row.iter().map(|value| value / squared.sqrt()));
        }
    }
    Array2::from_shape_vec((rows.len() / GENERIC_SIZE, GENERIC_SIZE), rows).expect("whole rows")
}

/// Mean of g gᵀ over rows g.
fn mean_outer_product(rows: &Array2<f32>) -> Moments {
    let mut sum = Moments::zeros();
    for block in rows.axis_chunks_iter(Axis(0), BLOCK) {
        let product = block.t().dot(&block);
        sum += Moments::from_fn(|row, column| product[[row, column]].into());
    }
    // Exactly symmetric in spite of rounding.
    (sum + sum.transpose()) / (2.0 * rows.nrows() as f64)
}

/// Eigenvectors of the largest eigenvalues, largest first. Their signs make the entry with the
/// largest absolute value positive.
fn principal_rows(moments: Moments, count: usize) -> Vec<f32> {
    let eigen = SymmetricEigen::new(moments);
    let mut order: Vec<usize> = (0..GENERIC_SIZE).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    let mut rows = Vec::with_capacity(count * GENERIC_SIZE);
    for &at in &order[..count] {
        let direction = eigen.eigenvectors.column(at);
        let sign = direction[direction.iamax()].signum();
        rows.extend(direction.iter().map(|&value| (value * sign) as f32));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn a_rare_direction_outside_the_basis_is_decoded() {
        // One direction with noise along four others; one pixel in 200 has a different direction.
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let mut rare = vec![0.0; GENERIC_SIZE];
        (rare[1], rare[31]) = (0.6, 0.8);
        let mut pixel = |at: usize| {
            if at.is_multiple_of(200) {
                return rare.clone();
            }
            let mut code = vec![0.0; GENERIC_SIZE];
            code[0] = 1.0;
            (1..5).for_each(|axis| code[axis] = random.random_range(-0.2..0.2));
            code
        };
        let codes: Vec<f32> = (0..4000).flat_map(&mut pixel).collect();
        let mut stage = Linear::new(4, 0.001);
        stage.observe(&codes);
        let cosine = |stage: &Linear| {
            let decoded = stage.decode(&stage.encode(&rare));
            decoded.iter().zip(&rare).map(|(a, b)| a * b).sum::<f32>()
        };
        assert!(cosine(&stage) > 0.99, "{}", cosine(&stage));
        // Negative control: the basis alone does not decode it.
        stage.decoder = Dictionary::default().decoder(&stage.basis);
        assert!(cosine(&stage) < 0.8, "{}", cosine(&stage));
    }

    fn basis(angle: f32) -> Vec<f32> {
        // Two orthonormal rows in the plane of the first two axes, the second one reflected.
        let mut rows = vec![0.0; 2 * GENERIC_SIZE];
        (rows[0], rows[1]) = (angle.cos(), angle.sin());
        (rows[GENERIC_SIZE], rows[GENERIC_SIZE + 1]) = (angle.sin(), -angle.cos());
        rows
    }

    #[test]
    fn a_basis_of_the_same_span_is_rotated_back() {
        let (old, new) = (basis(0.0), basis(2.0));
        let furthest =
            |a: &[f32]| a.iter().zip(&old).map(|(a, b)| (a - b).abs()).fold(0.0_f32, f32::max);
        assert!(furthest(&rotated_towards(&old, &new)) < 1e-5);
        // Negative control: without the rotation it is far away.
        assert!(furthest(&new) > 1.0);
    }
}
