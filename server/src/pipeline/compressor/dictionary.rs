//! What was seen, as a bounded set of directions: what a short code leaves out is looked up here.
//!
//! In: the generic codes of keyframes. Out: for a short code, the part of its generic code that the
//! basis does not span. It must not grow with the number of keyframes.
//!
//! A short code of something seen before is near to the short code of one of these directions, also
//! where the basis keeps only half of it: things are few and 15 dimensions are many. The remainder is
//! the mean of the remainders of the nearest directions, weighed by exp(-sharpness (1 - cosine)): a
//! regression with a kernel (Nadaraya 1964, Watson 1964). Far from all of them there is none.
//!
//! The directions are means of what is nearest to them; a new one begins where nothing is near. When
//! there are too many, what is near widens and neighbours join (Charikar et al., *Incremental
//! clustering*, 1997).

use super::GENERIC;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis};
use rayon::prelude::*;

/// The most directions.
const CAPACITY: usize = 512;
/// 1 - cosine within which something is nothing new, at first; and by how much it widens.
const RADIUS: f32 = 0.1;
const WIDENING: f32 = 1.25;
/// Codes of a keyframe that are looked at, evenly spread.
const SAMPLED: usize = 4096;
/// Of the kernel.
const SHARPNESS: f32 = 80.0;
/// Weight of there being no remainder: that of a direction at a cosine of 0.94.
const NONE: f32 = 0.01;
/// Cosine from which on a direction weighs anything: a hundredth of [`NONE`].
const NEAR: f32 = 0.885;
/// A direction of which the basis keeps less has no code to look it up by.
const LEAST_KEPT: f32 = 0.25;
/// Codes that one core reads at a time.
const BATCH: usize = 1024;

/// The directions that were seen.
#[derive(Clone)]
pub(super) struct Dictionary {
    radius: f32,
    /// Sums of what is nearest, `[k, 32]`.
    sums: Vec<[f64; GENERIC]>,
    /// The same, of unit length.
    directions: Vec<[f32; GENERIC]>,
}

impl Default for Dictionary {
    fn default() -> Self {
        Self { radius: RADIUS, sums: Vec::new(), directions: Vec::new() }
    }
}

impl Dictionary {
    /// Learns from unit codes `[n, 32]`.
    pub(super) fn observe(&mut self, codes: &Array2<f32>) {
        let stride = codes.nrows().div_ceil(SAMPLED).max(1);
        let rows = codes.select(Axis(0), &(0..codes.nrows()).step_by(stride).collect::<Vec<_>>());
        let mut nearest = self.nearest(&rows);
        let least = |nearest: &[(usize, f32)]| {
            (0..nearest.len()).min_by(|&a, &b| nearest[a].1.total_cmp(&nearest[b].1))
        };
        while let Some(furthest) = least(&nearest)
            && nearest[furthest].1 < 1.0 - self.radius
        {
            let code = rows.row(furthest);
            let new = self.directions.len();
            self.directions.push(std::array::from_fn(|at| code[at]));
            self.sums.push([0.0; GENERIC]);
            for (row, (at, cosine)) in rows.outer_iter().zip(&mut nearest) {
                let here = row.dot(&code);
                if here > *cosine {
                    (*at, *cosine) = (new, here);
                }
            }
            if self.directions.len() == CAPACITY {
                self.join_neighbours();
                nearest = self.nearest(&rows);
            }
        }
        for (row, &(at, _)) in rows.outer_iter().zip(&nearest) {
            self.sums[at].iter_mut().zip(row).for_each(|(sum, &value)| *sum += f64::from(value));
        }
        for (direction, sum) in self.directions.iter_mut().zip(&self.sums) {
            *direction = unit(sum).unwrap_or(*direction);
        }
    }

    /// Widens what is near until a quarter of the room is free.
    fn join_neighbours(&mut self) {
        while self.directions.len() > CAPACITY * 3 / 4 {
            self.radius *= WIDENING;
            let mut kept: Vec<usize> = Vec::new();
            for at in 0..self.directions.len() {
                let near = kept.iter().copied().find(|&other| {
                    let pair = self.directions[other].iter().zip(&self.directions[at]);
                    pair.map(|(a, b)| a * b).sum::<f32>() >= 1.0 - self.radius
                });
                match near {
                    Some(other) => {
                        let sum = self.sums[at];
                        self.sums[other].iter_mut().zip(sum).for_each(|(to, of)| *to += of);
                    }
                    None => kept.push(at),
                }
            }
            self.sums = kept.iter().map(|&at| self.sums[at]).collect();
            let direction = |(&at, sum)| unit(sum).unwrap_or(self.directions[at]);
            self.directions = kept.iter().zip(&self.sums).map(direction).collect();
        }
    }

    /// The nearest direction to each of the codes `[n, 32]` and its cosine.
    fn nearest(&self, codes: &Array2<f32>) -> Vec<(usize, f32)> {
        let best = |row: ArrayView1<f32>| {
            let better = |best: (usize, f32), (at, &cosine): (usize, &f32)| {
                if cosine > best.1 { (at, cosine) } else { best }
            };
            row.iter().enumerate().fold((0, f32::NEG_INFINITY), better)
        };
        codes.dot(&self.matrix().t()).outer_iter().map(best).collect()
    }

    fn matrix(&self) -> ArrayView2<'_, f32> {
        ArrayView2::from_shape((self.directions.len(), GENERIC), self.directions.as_flattened())
            .expect("whole rows")
    }

    /// What short codes mean with a basis `[code_size, 32]` of orthonormal rows.
    pub(super) fn read_by(&self, basis: &[f32]) -> Reader {
        let basis =
            Array2::from_shape_vec((basis.len() / GENERIC, GENERIC), basis.to_vec()).expect("rows");
        let (mut keys, mut remainders) = (Vec::new(), Vec::new());
        for direction in &self.directions {
            let direction = ArrayView1::from(direction);
            let code = basis.dot(&direction);
            let length = code.dot(&code).sqrt();
            if length > LEAST_KEPT {
                let spanned = code.dot(&basis);
                keys.extend(code.iter().map(|value| value / length));
                remainders.push(std::array::from_fn(|at| (direction[at] - spanned[at]) / length));
            }
        }
        let keys = Array2::from_shape_vec((remainders.len(), basis.nrows()), keys).expect("rows");
        Reader { basis, keys, remainders }
    }
}

/// From short codes to generic ones.
#[derive(Clone)]
pub(super) struct Reader {
    /// `[code_size, 32]`.
    basis: Array2<f32>,
    /// Short codes of the directions, unit length, `[k, code_size]`.
    keys: Array2<f32>,
    /// What the basis leaves out of a direction whose short code has unit length, `[k, 32]`.
    remainders: Vec<[f32; GENERIC]>,
}

impl Reader {
    /// Short codes `[n, code_size]` as generic ones `[n, 32]`, not of unit length; zeros stay zeros.
    pub(super) fn generic(&self, codes: &[f32]) -> Vec<f32> {
        let size = self.basis.nrows();
        let mut generic = vec![0.0; codes.len() / size * GENERIC];
        let batches = codes.par_chunks(BATCH * size).zip(generic.par_chunks_mut(BATCH * GENERIC));
        batches.for_each(|(codes, generic)| self.read(codes, generic));
        generic
    }

    fn read(&self, codes: &[f32], generic: &mut [f32]) {
        let size = self.basis.nrows();
        let mut units = codes.to_vec();
        super::normalise_rows(&mut units, size);
        let units = ArrayView2::from_shape((units.len() / size, size), &units).expect("whole rows");
        let (spanned, cosines) = (units.dot(&self.basis), units.dot(&self.keys.t()));
        let rows = generic.chunks_exact_mut(GENERIC).zip(spanned.outer_iter());
        for ((generic, spanned), cosines) in rows.zip(cosines.outer_iter()) {
            let (mut total, mut remainder) = (NONE, [0.0; GENERIC]);
            for (&cosine, along) in cosines.iter().zip(&self.remainders) {
                if cosine > NEAR {
                    let weight = (SHARPNESS * (cosine - 1.0)).exp();
                    total += weight;
                    remainder.iter_mut().zip(along).for_each(|(to, of)| *to += weight * of);
                }
            }
            for ((to, along), remainder) in generic.iter_mut().zip(spanned).zip(remainder) {
                *to = along + remainder / total;
            }
        }
    }
}

fn unit(sum: &[f64; GENERIC]) -> Option<[f32; GENERIC]> {
    let length = sum.iter().map(|value| value * value).sum::<f64>().sqrt();
    (length > 0.0).then(|| sum.map(|value| (value / length) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::compressor::normalise_rows;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Unit codes scattered by `noise` around `centers`, `each` of every one in turn.
    fn around(centers: &[[f32; GENERIC]], each: usize, noise: f32, seed: u64) -> Array2<f32> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut codes = Vec::new();
        for _ in 0..each {
            for center in centers {
                codes.extend(center.map(|value| value + random.random_range(-noise..=noise)));
            }
        }
        normalise_rows(&mut codes, GENERIC);
        Array2::from_shape_vec((each * centers.len(), GENERIC), codes).unwrap()
    }

    fn random_centers(count: usize, seed: u64) -> Vec<[f32; GENERIC]> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..count)
            .map(|_| unit(&std::array::from_fn(|_| random.random_range(-1.0..1.0))).unwrap())
            .collect()
    }

    fn first_axes(count: usize) -> Vec<f32> {
        let mut basis = vec![0.0; count * GENERIC];
        (0..count).for_each(|axis| basis[axis * GENERIC + axis] = 1.0);
        basis
    }

    fn dot(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    #[test]
    fn what_the_basis_leaves_out_is_looked_up() {
        let centers = random_centers(30, 1);
        let mut dictionary = Dictionary::default();
        dictionary.observe(&around(&centers, 20, 0.02, 2));
        assert_eq!(dictionary.directions.len(), 30);
        // The basis keeps about half of the squared length of each.
        let basis = first_axes(15);
        let again = around(&centers, 3, 0.02, 3);
        let codes: Vec<f32> = again
            .outer_iter()
            .flat_map(|code| code.iter().copied().take(15).collect::<Vec<_>>())
            .collect();
        let least = |reader: &Reader| {
            let mut generic = reader.generic(&codes);
            normalise_rows(&mut generic, GENERIC);
            let pairs = generic.chunks_exact(GENERIC).zip(again.outer_iter());
            pairs.map(|(a, b)| dot(a, b.as_slice().unwrap())).fold(1.0_f32, f32::min)
        };
        // Measured: 0.998.
        assert!(least(&dictionary.read_by(&basis)) > 0.97);
        // Negative control: without what was seen it is what the basis keeps.
        assert!(least(&Dictionary::default().read_by(&basis)) < 0.7);
    }

    #[test]
    fn far_from_everything_seen_there_is_no_remainder() {
        let centers = random_centers(1, 4);
        let mut dictionary = Dictionary::default();
        dictionary.observe(&around(&centers, 4, 0.0, 5));
        let reader = dictionary.read_by(&first_axes(15));
        let mut elsewhere = centers[0][..15].to_vec();
        elsewhere.rotate_left(1);
        let generic =
            reader.generic(&[elsewhere, centers[0][..15].to_vec(), vec![0.0; 15]].concat());
        assert!(generic[15..GENERIC].iter().all(|&value| value == 0.0));
        // Negative controls: there it is; and nothing stays nothing.
        assert!(generic[GENERIC + 15..2 * GENERIC].iter().any(|value| value.abs() > 0.1));
        assert!(generic[2 * GENERIC..].iter().all(|&value| value == 0.0));
    }

    #[test]
    fn it_does_not_grow_without_end_and_forgets_no_region() {
        let mut dictionary = Dictionary::default();
        let centers = random_centers(4 * CAPACITY, 6);
        for some in centers.chunks(100) {
            dictionary.observe(&around(some, 2, 0.01, 7));
            assert!(dictionary.directions.len() < CAPACITY);
        }
        assert!(dictionary.radius > RADIUS, "it had to widen");
        let codes = around(&centers, 1, 0.0, 8);
        let cosines = dictionary.nearest(&codes);
        let mean = cosines.iter().map(|(_, cosine)| cosine).sum::<f32>() / cosines.len() as f32;
        // Measured: 0.66.
        // Random directions of 32 dimensions are about 0.5 from the nearest of so many others.
        assert!(mean > 0.6, "{mean}");
        // Negative control: few fit without widening.
        let mut small = Dictionary::default();
        small.observe(&around(&centers[..300], 2, 0.01, 9));
        assert_eq!((small.radius, small.directions.len()), (RADIUS, 300));
    }
}
