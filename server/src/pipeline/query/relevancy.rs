//! How much a feature is what the words say (paper §5; the relevancy of LERF), and images of it.
//!
//! relevancy = min over negatives n of exp(t f·q) / (exp(t f·q) + exp(t f·n + b)), with f the
//! feature, q the query, all of unit length, and t and b the bundle's temperature and bias (the
//! paper: 10 and 0). 0.5: nearer to the query than to the nearest negative by b / t.

use super::cosines::{Component, cosines};
use crate::pipeline::bilinear;
use ndarray::{Array2, ArrayView1};
use rayon::prelude::*;

/// Features that one core compares at a time.
const BATCH: usize = 1024;

/// From cosines to relevancy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub temperature: f32,
    pub bias: f32,
}

/// Embedded words that features are compared with.
pub(super) struct Comparison {
    scale: Scale,
    /// The query, then the negatives, `[1 + n, D]`.
    words: Array2<f32>,
}

impl Comparison {
    /// `query` and each of `negatives` (at least one) are `[D]`, unit length.
    pub(super) fn new<'a>(
        scale: Scale,
        query: &'a [f32],
        negatives: impl IntoIterator<Item = &'a [f32]>,
    ) -> Self {
        let mut words = Array2::zeros((0, query.len()));
        for word in std::iter::once(query).chain(negatives) {
            words.push_row(ArrayView1::from(word)).expect("embeddings are of one size");
        }
        assert!(words.nrows() > 1, "at least one negative");
        Self { scale, words }
    }

    /// Relevancies, 0..1, of features `[n, D]`, unit length.
    pub(super) fn relevancies<T: Component>(&self, features: &[T]) -> Vec<f32> {
        compared(self.scale, (&self.words, 1), features)
    }
}

/// Relevancies `[n, texts]`, 0..1, of features `[n, D]` to the first `texts` of the words `[.., D]`; the
/// others are the negatives. All are of unit length.
pub(super) fn compared<T: Component>(
    Scale { temperature, bias }: Scale,
    (words, texts): (&Array2<f32>, usize),
    features: &[T],
) -> Vec<f32> {
    let size = words.ncols();
    features
        .par_chunks(BATCH * size)
        .flat_map_iter(|batch| {
            let cosines = cosines(batch, words);
            let mut found = Vec::with_capacity(batch.len() / size * texts);
            for row in cosines.chunks_exact(words.nrows()) {
                let (texts, negatives) = row.split_at(texts);
                // The least pair is that with the nearest negative.
                let nearest = negatives.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let relevancy =
                    |cosine: &f32| 1.0 / (1.0 + (temperature * (nearest - cosine) + bias).exp());
                found.extend(texts.iter().map(relevancy));
            }
            found
        })
        .collect()
}

/// An image of one channel, `[height * width]`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Plane {
    /// The value at a row and a column.
    #[cfg(test)]
    fn at(&self, row: usize, column: usize) -> f32 {
        self.values[row * self.width + column]
    }

    /// The same area at another size.
    pub(super) fn resized(&self, width: usize, height: usize) -> Self {
        let values = bilinear::resized(&self.values, (self.width, self.height), (width, height));
        Self { width, height, values }
    }

    /// Mean over a square of `side` pixels; beyond the border the image is mirrored at the border
    /// pixels (reflect 101). An even square reaches one pixel further to the left and up.
    pub(super) fn smoothed(&self, side: usize) -> Self {
        if side <= 1 {
            return self.clone();
        }
        let mut across = self.clone();
        for row in across.values.chunks_exact_mut(self.width) {
            running_mean(row, side);
        }
        let mut column = vec![0.0; self.height];
        for x in 0..self.width {
            let at = |y: usize| y * self.width + x;
            (0..self.height).for_each(|y| column[y] = across.values[at(y)]);
            running_mean(&mut column, side);
            (0..self.height).for_each(|y| across.values[at(y)] = column[y]);
        }
        across
    }
}

/// Mean over `side` neighbours along a line, mirrored at its ends.
fn running_mean(line: &mut [f32], side: usize) {
    let before = side / 2;
    let mut sums = Vec::with_capacity(line.len() + side);
    let mut sum = 0.0_f64;
    sums.push(sum);
    for i in 0..line.len() + side - 1 {
        sum += f64::from(line[mirrored(i as isize - before as isize, line.len())]);
        sums.push(sum);
    }
    for (i, value) in line.iter_mut().enumerate() {
        *value = ((sums[i + side] - sums[i]) / side as f64) as f32;
    }
}

/// The index within `0..length` that `index` mirrors to; the ends are not repeated.
fn mirrored(index: isize, length: usize) -> usize {
    if length == 1 {
        return 0;
    }
    let period = 2 * (length as isize - 1);
    let at = index.rem_euclid(period);
    at.min(period - at) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relevancy_is_the_least_of_the_pairs() {
        let (query, first, second) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]);
        let scale = Scale { temperature: 10.0, bias: 0.0 };
        let comparison = Comparison::new(scale, &query, [&first[..], &second[..]]);
        let feature = [0.8, 0.6, 0.0];
        // f·q = 0.8, f·n = 0.6 and 0.48: by hand 1 / (1 + exp(10 (0.6 - 0.8))).
        let expected = 1.0 / (1.0 + (-2.0_f32).exp());
        assert!((comparison.relevancies(&feature)[0] - expected).abs() < 1e-6);
        // Negative control: without the nearer negative it is another number.
        let other = Comparison::new(scale, &query, [&second[..]]).relevancies(&feature)[0];
        assert!((other - 1.0 / (1.0 + (-3.2_f32).exp())).abs() < 1e-6);
        assert!((other - expected).abs() > 0.05);
        // As near to the query as to a negative; every row has its own.
        let between = [0.5_f32.sqrt(), 0.5_f32.sqrt(), 0.0];
        let both = comparison.relevancies(&[between, feature].concat());
        assert!((both[0] - 0.5).abs() < 1e-6 && (both[1] - expected).abs() < 1e-6);
        assert!(comparison.relevancies::<f32>(&[]).is_empty());
    }

    #[test]
    fn a_bias_moves_where_one_half_is() {
        let (query, negative) = ([1.0, 0.0], [0.0, 1.0]);
        let biased = |bias| {
            let scale = Scale { temperature: 10.0, bias };
            Comparison::new(scale, &query, [&negative[..]]).relevancies(&[0.8, 0.6])[0]
        };
        // t (f·q - f·n) = 10 (0.8 - 0.6) = 2: a bias of 2 makes it one half, of 3 less.
        assert!((biased(2.0) - 0.5).abs() < 1e-6);
        assert!((biased(3.0) - 1.0 / (1.0 + 1.0_f32.exp())).abs() < 1e-6);
        // Negative control: without a bias it is the plain softmax.
        assert!((biased(0.0) - 1.0 / (1.0 + (-2.0_f32).exp())).abs() < 1e-6);
    }

    #[test]
    fn smoothing_is_the_mean_with_a_mirrored_border() {
        let line = Plane { width: 5, height: 1, values: vec![0.0, 0.0, 9.0, 0.0, 3.0] };
        assert_eq!(line.smoothed(3).values, [0.0, 3.0, 3.0, 4.0, 1.0]);
        // An even side reaches further left: x-1 and x.
        assert_eq!(line.smoothed(2).values, [0.0, 0.0, 4.5, 4.5, 1.5]);
        assert_eq!(line.smoothed(1), line);
        // Much larger than the image: still a mean of what is there.
        let wide = line.smoothed(41);
        assert!(wide.values.iter().all(|v| (0.0..=9.0).contains(v)), "{wide:?}");
    }

    #[test]
    fn smoothing_works_along_both_axes_and_keeps_a_flat_image() {
        let mut plane = Plane { width: 7, height: 6, values: vec![0.25; 42] };
        assert!(plane.smoothed(4).values.iter().all(|v| (v - 0.25).abs() < 1e-6));
        plane.values[3 * 7 + 3] = 9.25;
        let smooth = plane.smoothed(3);
        assert!((smooth.at(2, 4) - 1.25).abs() < 1e-6 && (smooth.at(4, 2) - 1.25).abs() < 1e-6);
        assert!((smooth.at(1, 3) - 0.25).abs() < 1e-6);
    }

    #[test]
    fn resizing_keeps_ramps_and_places() {
        let ramp = Plane {
            width: 8,
            height: 4,
            values: (0..32).map(|i| (i % 8) as f32 + 10.0 * (i / 8) as f32).collect(),
        };
        let large = ramp.resized(16, 8);
        // Pixel (5, 3) of the large image is at 2.25, 1.25 of the small one.
        assert!((large.at(3, 5) - (2.25 + 12.5)).abs() < 1e-5);
        assert_eq!(ramp.resized(8, 4), ramp);
    }
}
