//! A bounded dictionary of observed directions, from which the part of a generic code that the
//! basis does not span is looked up.
//!
//! In: the generic codes of keyframes. Out: for an online code, its generic code. The size does not
//! grow with the number of keyframes.
//!
//! An online code of an observed direction is near the online code of one of the entries, even
//! where the basis keeps only half of its length: scenes have few distinct directions, and 15
//! dimensions separate them. The remainder is the mean of the entries' remainders, weighted by
//! `exp(-SHARPNESS (1 - cosine))`: kernel regression (Nadaraya 1964, Watson 1964). Far from all
//! entries it is zero.
//!
//! Entries are means of the codes that are nearest to them. A code that is near no entry starts a
//! new one. A full dictionary increases its radius and merges entries (Charikar et al.,
//! *Incremental clustering*, 1997).

use super::rows::normalise_rows;
use crate::pipeline::network::GENERIC_SIZE;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The most entries.
const CAPACITY: usize = 512;
/// Initial radius: 1 - cosine below which a code belongs to an entry.
const RADIUS: f32 = 0.1;
/// Factor by which a full dictionary increases its radius.
const WIDENING: f32 = 1.25;
/// Codes used of a keyframe, evenly spread.
const SAMPLED: usize = 4096;
/// Sharpness of the kernel.
const SHARPNESS: f32 = 80.0;
/// Weight of a zero remainder: the kernel at a cosine of 0.94.
const ZERO_WEIGHT: f32 = 0.01;
/// Entries with a smaller cosine are skipped; their weight is below a hundredth of [`ZERO_WEIGHT`].
const MIN_COSINE: f32 = 0.885;
/// Entries of which the basis keeps less length are not looked up.
const MIN_KEPT: f32 = 0.25;
/// Codes decoded by one core at a time.
const BATCH: usize = 1024;

/// Directions of the observed codes.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Dictionary {
    radius: f32,
    /// Sums of the codes of each entry, `[k, 32]`.
    sums: Vec<[f64; GENERIC_SIZE]>,
    /// The same sums, scaled to unit length, `[k, 32]`.
    directions: Vec<[f32; GENERIC_SIZE]>,
}

impl Default for Dictionary {
    fn default() -> Self {
        Self { radius: RADIUS, sums: Vec::new(), directions: Vec::new() }
    }
}

impl Dictionary {
    /// Whether each entry has a sum and a direction.
    pub(super) fn is_whole(&self) -> bool {
        self.sums.len() == self.directions.len()
    }

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
            self.sums.push([0.0; GENERIC_SIZE]);
            for (row, (at, cosine)) in rows.outer_iter().zip(&mut nearest) {
                let here = row.dot(&code);
                if here > *cosine {
                    (*at, *cosine) = (new, here);
                }
            }
            if self.directions.len() == CAPACITY {
                self.merge_entries();
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

    /// Increases the radius and merges entries until a quarter of the capacity is free.
    fn merge_entries(&mut self) {
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

    /// The nearest entry to each of the codes `[n, 32]`, with its cosine.
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
        ArrayView2::from_shape(
            (self.directions.len(), GENERIC_SIZE),
            self.directions.as_flattened(),
        )
        .expect("whole rows")
    }

    /// A decoder for codes of a basis with orthonormal rows `[code_size, 32]`.
    pub(super) fn decoder(&self, basis: &[f32]) -> DictionaryDecoder {
        let basis =
            Array2::from_shape_vec((basis.len() / GENERIC_SIZE, GENERIC_SIZE), basis.to_vec())
                .expect("rows");
        let (mut keys, mut remainders) = (Vec::new(), Vec::new());
        for direction in &self.directions {
            let direction = ArrayView1::from(direction);
            let code = basis.dot(&direction);
            let length = code.dot(&code).sqrt();
            if length > MIN_KEPT {
                let spanned = code.dot(&basis);
                keys.extend(code.iter().map(|value| value / length));
                remainders.push(std::array::from_fn(|at| (direction[at] - spanned[at]) / length));
            }
        }
        let keys = Array2::from_shape_vec((remainders.len(), basis.nrows()), keys).expect("rows");
        DictionaryDecoder { basis, keys, remainders }
    }
}

/// Decodes online codes to generic codes.
#[derive(Clone, Default)]
pub(super) struct DictionaryDecoder {
    /// `[code_size, 32]`.
    basis: Array2<f32>,
    /// Online codes of the entries, unit length, `[k, code_size]`.
    keys: Array2<f32>,
    /// The part of each entry outside the basis, scaled so that the entry's online code has unit
    /// length, `[k, 32]`.
    remainders: Vec<[f32; GENERIC_SIZE]>,
}

impl DictionaryDecoder {
    /// Online codes `[n, code_size]` to generic codes `[n, 32]`, not normalised; zeros stay zeros.
    pub(super) fn decode(&self, codes: &[f32]) -> Vec<f32> {
        let size = self.basis.nrows();
        let mut generic = vec![0.0; codes.len() / size * GENERIC_SIZE];
        let batches =
            codes.par_chunks(BATCH * size).zip(generic.par_chunks_mut(BATCH * GENERIC_SIZE));
        batches.for_each(|(codes, generic)| self.decode_batch(codes, generic));
        generic
    }

    fn decode_batch(&self, codes: &[f32], generic: &mut [f32]) {
        let size = self.basis.nrows();
        let mut units = codes.to_vec();
        normalise_rows(&mut units, size);
        let units = ArrayView2::from_shape((units.len() / size, size), &units).expect("whole rows");
        let (spanned, cosines) = (units.dot(&self.basis), units.dot(&self.keys.t()));
        let rows = generic.chunks_exact_mut(GENERIC_SIZE).zip(spanned.outer_iter());
        for ((generic, spanned), cosines) in rows.zip(cosines.outer_iter()) {
            let (mut total, mut remainder) = (ZERO_WEIGHT, [0.0; GENERIC_SIZE]);
            for (&cosine, along) in cosines.iter().zip(&self.remainders) {
                if cosine > MIN_COSINE {
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

fn unit(sum: &[f64; GENERIC_SIZE]) -> Option<[f32; GENERIC_SIZE]> {
    let length = sum.iter().map(|value| value * value).sum::<f64>().sqrt();
    (length > 0.0).then(|| sum.map(|value| (value / length) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Unit codes around `centers` with uniform `noise`: `each` codes per centre, in turn.
    fn around(centers: &[[f32; GENERIC_SIZE]], each: usize, noise: f32, seed: u64) -> Array2<f32> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut codes = Vec::new();
        for _ in 0..each {
            for center in centers {
                codes.extend(center.map(|value| value + random.random_range(-noise..=noise)));
            }
        }
        normalise_rows(&mut codes, GENERIC_SIZE);
        Array2::from_shape_vec((each * centers.len(), GENERIC_SIZE), codes).unwrap()
    }

    fn random_centers(count: usize, seed: u64) -> Vec<[f32; GENERIC_SIZE]> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..count)
            .map(|_| unit(&std::array::from_fn(|_| random.random_range(-1.0..1.0))).unwrap())
            .collect()
    }

    fn first_axes(count: usize) -> Vec<f32> {
        let mut basis = vec![0.0; count * GENERIC_SIZE];
        (0..count).for_each(|axis| basis[axis * GENERIC_SIZE + axis] = 1.0);
        basis
    }

    fn dot(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    #[test]
    fn the_part_outside_the_basis_is_looked_up() {
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
        let least = |decoder: &DictionaryDecoder| {
            let mut generic = decoder.decode(&codes);
            normalise_rows(&mut generic, GENERIC_SIZE);
            let pairs = generic.chunks_exact(GENERIC_SIZE).zip(again.outer_iter());
            pairs.map(|(a, b)| dot(a, b.as_slice().unwrap())).fold(1.0_f32, f32::min)
        };
        // Measured: 0.998.
        assert!(least(&dictionary.decoder(&basis)) > 0.97);
        // Negative control: an empty dictionary leaves only the part within the basis.
        assert!(least(&Dictionary::default().decoder(&basis)) < 0.7);
    }

    #[test]
    fn far_from_all_entries_there_is_no_remainder() {
        let centers = random_centers(1, 4);
        let mut dictionary = Dictionary::default();
        dictionary.observe(&around(&centers, 4, 0.0, 5));
        let decoder = dictionary.decoder(&first_axes(15));
        let mut elsewhere = centers[0][..15].to_vec();
        elsewhere.rotate_left(1);
        let generic =
            decoder.decode(&[elsewhere, centers[0][..15].to_vec(), vec![0.0; 15]].concat());
        assert!(generic[15..GENERIC_SIZE].iter().all(|&value| value == 0.0));
        // Negative controls: an entry has its remainder, and zeros stay zeros.
        assert!(generic[GENERIC_SIZE + 15..2 * GENERIC_SIZE].iter().any(|value| value.abs() > 0.1));
        assert!(generic[2 * GENERIC_SIZE..].iter().all(|&value| value == 0.0));
    }

    #[test]
    fn the_size_is_bounded_and_no_region_is_forgotten() {
        let mut dictionary = Dictionary::default();
        let centers = random_centers(4 * CAPACITY, 6);
        for some in centers.chunks(100) {
            dictionary.observe(&around(some, 2, 0.01, 7));
            assert!(dictionary.directions.len() < CAPACITY);
        }
        assert!(dictionary.radius > RADIUS, "the radius has increased");
        let codes = around(&centers, 1, 0.0, 8);
        let cosines = dictionary.nearest(&codes);
        let mean = cosines.iter().map(|(_, cosine)| cosine).sum::<f32>() / cosines.len() as f32;
        // Measured: 0.66.
        // Random directions of 32 dimensions are about 0.5 from the nearest of so many others.
        assert!(mean > 0.6, "{mean}");
        // Negative control: few entries fit at the initial radius.
        let mut small = Dictionary::default();
        small.observe(&around(&centers[..300], 2, 0.01, 9));
        assert_eq!((small.radius, small.directions.len()), (RADIUS, 300));
    }
}
