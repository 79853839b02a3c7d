//! Linear online stage: the leading eigenvectors of the second moments of all codes seen, and a
//! dictionary of the directions that they do not span.
//!
//! code = W g, g = direction of Wᵀ code + r(code), with W `[code_size, 32]` orthonormal rows and r what the
//! basis leaves out of codes like this one ([`Dictionary`]): of what is rare a small basis keeps little,
//! and little is enough to know it again. Rendering is a weighted sum and commutes with W, so a blended
//! code decodes to the blend of what was written; no keyframe is forgotten, because the moments are
//! sums. Every keyframe weighs the same. When the basis moves, it is turned within its span so that
//! codes change as little as they can.

use super::dictionary::{Dictionary, Reader};
use super::{GENERIC, OnlineStage, normalise_rows};
use nalgebra::{DMatrix, SMatrix, SVector, SymmetricEigen};
use ndarray::{Array2, Axis};

type Moments = SMatrix<f64, GENERIC, GENERIC>;
type Code = SVector<f64, GENERIC>;

/// Rows that are summed in single precision before the sum goes on in double.
const BLOCK: usize = 512;

/// Running principal directions.
#[derive(Clone)]
pub struct Linear {
    code_size: usize,
    tolerance: f64,
    version: u64,
    keyframes: u64,
    /// Sum over keyframes of the mean g gᵀ.
    moments: Moments,
    /// `[code_size, 32]`, orthonormal rows.
    basis: Vec<f32>,
    dictionary: Dictionary,
    reader: Reader,
}

impl Linear {
    /// Before any keyframe: the first axes. `tolerance`: the share of the squared length of all
    /// codes seen that must be lost, beyond what the best basis loses, before the basis moves.
    pub fn new(code_size: usize, tolerance: f64) -> Self {
        let mut basis = vec![0.0; code_size * GENERIC];
        for axis in 0..code_size {
            basis[axis * GENERIC + axis] = 1.0;
        }
        let dictionary = Dictionary::default();
        Self {
            code_size,
            tolerance,
            version: 0,
            keyframes: 0,
            moments: Moments::zeros(),
            reader: dictionary.read_by(&basis),
            basis,
            dictionary,
        }
    }

    /// How much of the squared length of all codes seen a basis keeps.
    fn kept(&self, basis: &[f32]) -> f64 {
        let row_kept = |row: &[f32]| {
            let row = Code::from_iterator(row.iter().map(|&v| v.into()));
            row.dot(&(self.moments * row))
        };
        basis.chunks_exact(GENERIC).map(row_kept).sum()
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
        let moves = self.version == 0 || lost > self.tolerance * self.keyframes as f64;
        if moves {
            self.basis = if self.version == 0 { best } else { turned_towards(&self.basis, &best) };
            self.version += 1;
        }
        self.reader = self.dictionary.read_by(&self.basis);
        moves
    }

    fn encode(&self, generic: &[f32]) -> Vec<f32> {
        let mut codes = Vec::with_capacity(generic.len() / GENERIC * self.code_size);
        for row in generic.chunks_exact(GENERIC) {
            for direction in self.basis.chunks_exact(GENERIC) {
                codes.push(row.iter().zip(direction).map(|(a, b)| a * b).sum());
            }
        }
        codes
    }

    fn decode(&self, codes: &[f32]) -> Vec<f32> {
        let mut generic = self.reader.generic(codes);
        normalise_rows(&mut generic, GENERIC);
        generic
    }

    fn boxed_clone(&self) -> Box<dyn OnlineStage> {
        Box::new(self.clone())
    }
}

/// The basis that spans what `new` spans and is nearest to `old` (orthogonal Procrustes, Schönemann
/// 1966): codes change as little as they can, and so does what an optimiser knows of them.
fn turned_towards(old: &[f32], new: &[f32]) -> Vec<f32> {
    let rows = |basis: &[f32]| DMatrix::from_row_slice(basis.len() / GENERIC, GENERIC, basis);
    let (old, new) = (rows(old), rows(new));
    let svd = (&old * new.transpose()).svd(true, true);
    let (left, right) = svd.u.zip(svd.v_t).expect("both were asked for");
    (left * right * new).transpose().as_slice().to_vec()
}

/// The rows that have a direction, of unit length, `[n, 32]`.
fn directions(generic: &[f32]) -> Array2<f32> {
    let mut rows = Vec::with_capacity(generic.len());
    for row in generic.chunks_exact(GENERIC) {
        let squared = row.iter().map(|value| value * value).sum::<f32>();
        if squared.is_finite() && squared > 0.0 {
            rows.extend(row.iter().map(|value| value / squared.sqrt()));
        }
    }
    Array2::from_shape_vec((rows.len() / GENERIC, GENERIC), rows).expect("whole rows")
}

/// Mean of g gᵀ over rows g.
fn mean_outer_product(rows: &Array2<f32>) -> Moments {
    let mut sum = Moments::zeros();
    for block in rows.axis_chunks_iter(Axis(0), BLOCK) {
        let product = block.t().dot(&block);
        sum += Moments::from_fn(|row, column| product[[row, column]].into());
    }
    // Rounding must not make it lopsided.
    (sum + sum.transpose()) / (2.0 * rows.nrows() as f64)
}

/// Eigenvectors of the largest eigenvalues, largest first; the sign is such that the entry with the
/// greatest size is positive.
fn principal_rows(moments: Moments, count: usize) -> Vec<f32> {
    let eigen = SymmetricEigen::new(moments);
    let mut order: Vec<usize> = (0..GENERIC).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]).then(a.cmp(&b)));
    let mut rows = Vec::with_capacity(count * GENERIC);
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
    fn what_is_rare_is_read_although_the_basis_has_no_room_for_it() {
        // One direction that wavers along four others, and in one pixel of 200 something else.
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let mut rare = vec![0.0; GENERIC];
        (rare[1], rare[31]) = (0.6, 0.8);
        let mut pixel = |at: usize| {
            if at.is_multiple_of(200) {
                return rare.clone();
            }
            let mut code = vec![0.0; GENERIC];
            code[0] = 1.0;
            (1..5).for_each(|axis| code[axis] = random.random_range(-0.2..0.2));
            code
        };
        let codes: Vec<f32> = (0..4000).flat_map(&mut pixel).collect();
        let mut stage = Linear::new(4, 0.001);
        stage.observe(&codes);
        let read = |stage: &Linear| {
            let read = stage.decode(&stage.encode(&rare));
            read.iter().zip(&rare).map(|(a, b)| a * b).sum::<f32>()
        };
        assert!(read(&stage) > 0.99, "{}", read(&stage));
        // Negative control: by the basis alone it is something else.
        stage.reader = Dictionary::default().read_by(&stage.basis);
        assert!(read(&stage) < 0.8, "{}", read(&stage));
    }

    fn basis(angle: f32) -> Vec<f32> {
        // Two orthonormal rows in the plane of the first two axes, the second one mirrored.
        let mut rows = vec![0.0; 2 * GENERIC];
        (rows[0], rows[1]) = (angle.cos(), angle.sin());
        (rows[GENERIC], rows[GENERIC + 1]) = (angle.sin(), -angle.cos());
        rows
    }

    #[test]
    fn a_basis_of_the_same_span_is_turned_back() {
        let (old, new) = (basis(0.0), basis(2.0));
        let furthest =
            |a: &[f32]| a.iter().zip(&old).map(|(a, b)| (a - b).abs()).fold(0.0_f32, f32::max);
        assert!(furthest(&turned_towards(&old, &new)) < 1e-5);
        // Negative control: as it comes it is far away.
        assert!(furthest(&new) > 1.0);
    }
}
