//! Several texts that compete for every feature: an open-vocabulary segmentation.
//!
//! Each text has its relevancy (paper §5; see `relevancy`) = 1 / (1 + exp(t (max_n f·n - f·q) + b)); the negatives
//! are shared, so that the best text is the nearest, argmax f·q. A label is the best text's place in the
//! list, from 1; 0 where even that is not above the threshold.

use super::cosines::Component;
use super::relevancy::{Plane, Scale, compared};
use ndarray::{Array2, ArrayView1};
use rayon::prelude::*;
use std::sync::Arc;

/// Embedded texts and negatives.
pub(super) struct Rivals {
    scale: Scale,
    texts: usize,
    /// The texts, then the negatives, `[texts + negatives, D]`.
    words: Array2<f32>,
}

impl Rivals {
    /// Each is `[D]`, unit length; at least one of either.
    pub(super) fn new(scale: Scale, texts: &[Arc<[f32]>], negatives: &[Arc<[f32]>]) -> Self {
        assert!(!texts.is_empty() && !negatives.is_empty(), "at least one of either");
        let mut words = Array2::zeros((0, texts[0].len()));
        for word in texts.iter().chain(negatives) {
            words.push_row(ArrayView1::from(&word[..])).expect("embeddings are of one size");
        }
        Self { scale, texts: texts.len(), words }
    }

    /// How many texts.
    pub(super) fn len(&self) -> usize {
        self.texts
    }

    /// Relevancies `[n, texts]`, 0..1, of features `[n, D]`, unit length.
    pub(super) fn relevancies<T: Component>(&self, features: &[T]) -> Vec<f32> {
        compared(self.scale, (&self.words, self.texts), features)
    }
}

/// The best text's label and relevancy, of the relevancies to all texts.
pub(super) fn winner(relevancies: impl Iterator<Item = f32>, threshold: f32) -> (u8, f32) {
    let better = |best: (u8, f32), (at, score): (usize, f32)| {
        if score > best.1 { (at as u8 + 1, score) } else { best }
    };
    // Nothing is as little as -1: a relevancy of 0 is still the best of one.
    let (label, score) = relevancies.enumerate().fold((0, -1.0), better);
    (if score > threshold { label } else { 0 }, score.max(0.0))
}

/// Labels of every pixel, from a relevancy image of each text; all of one size.
pub(super) fn labels(planes: &[Plane], threshold: f32) -> Vec<u8> {
    let pixels = planes.first().map_or(0, |plane| plane.values.len());
    let pixel = |at: usize| winner(planes.iter().map(|plane| plane.values[at]), threshold).0;
    (0..pixels).into_par_iter().map(pixel).collect()
}

/// The share of each label from 1 to `texts`.
pub(super) fn shares(labels: impl ExactSizeIterator<Item = u8>, texts: usize) -> Vec<f32> {
    let all = labels.len().max(1) as f32;
    let mut counts = vec![0_usize; texts + 1];
    labels.for_each(|label| counts[usize::from(label)] += 1);
    counts[1..].iter().map(|&count| count as f32 / all).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::query::relevancy::Comparison;

    fn word(values: [f32; 3]) -> Arc<[f32]> {
        values.to_vec().into()
    }

    #[test]
    fn each_texts_relevancy_is_what_it_would_be_alone() {
        let texts = [word([1.0, 0.0, 0.0]), word([0.0, 0.6, 0.8])];
        let negatives = [word([0.0, 1.0, 0.0]), word([0.6, 0.0, 0.8])];
        let features = [[0.8, 0.6, 0.0], [0.0, 0.6, 0.8], [0.0, 1.0, 0.0]].concat();
        let found = Rivals::new(Scale { temperature: 10.0, bias: 0.0 }, &texts, &negatives)
            .relevancies(&features);
        assert_eq!(found.len(), 3 * 2);
        for (at, text) in texts.iter().enumerate() {
            let alone = Comparison::new(
                Scale { temperature: 10.0, bias: 0.0 },
                text,
                negatives.iter().map(|n| &n[..]),
            );
            for (row, expected) in alone.relevancies(&features).into_iter().enumerate() {
                assert!((found[row * 2 + at] - expected).abs() < 1e-6);
            }
        }
        let label =
            |row: usize, threshold| winner(found[row * 2..][..2].iter().copied(), threshold).0;
        assert_eq!([label(0, 0.5), label(1, 0.5), label(2, 0.5)], [1, 2, 0]);
        // Without a threshold everything is something.
        assert_eq!(label(2, 0.0), 2);
    }

    #[test]
    fn pixels_take_the_best_and_shares_count_them() {
        let plane = |values: [f32; 4]| Plane { width: 2, height: 2, values: values.to_vec() };
        let planes = [plane([0.9, 0.2, 0.6, 0.0]), plane([0.8, 0.7, 0.1, 0.0])];
        assert_eq!(labels(&planes, 0.5), [1, 2, 1, 0]);
        assert_eq!(labels(&planes, 0.65), [1, 2, 0, 0]);
        assert_eq!(labels(&planes, 0.0), [1, 2, 1, 0], "no language at all is no label");
        assert_eq!(shares([1, 2, 1, 0].into_iter(), 2), [0.5, 0.25]);
        assert_eq!(shares([].into_iter(), 2), [0.0, 0.0]);
    }
}
