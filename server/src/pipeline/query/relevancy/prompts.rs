//! Embedded texts that features are compared with (paper §5; the relevancy of LERF).
//!
//! relevancy(q) = min over negatives n of exp(t f·q) / (exp(t f·q) + exp(t f·n + b)), with feature
//! f, text q and negatives n of unit length, and the bundle's temperature t and bias b (10 and 0 in
//! the paper). It is 0.5 where f·q exceeds the greatest f·n by b / t.
//!
//! A query has one text. In a segmentation several texts share the negatives, so that the most
//! relevant text is the nearest one.

use super::cosines::{Component, cosines};
use ndarray::{Array2, ArrayView1};
use rayon::prelude::*;
use std::sync::Arc;

/// Features compared by one core at a time.
const BATCH: usize = 1024;

/// Parameters from cosines to relevancy.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    pub temperature: f32,
    pub bias: f32,
}

/// Embedded texts and negatives.
pub(crate) struct Prompts {
    scale: Scale,
    texts: usize,
    /// The texts, then the negatives, `[texts + negatives, D]`, unit length.
    embeddings: Array2<f32>,
}

impl Prompts {
    /// Embeddings `[D]` of unit length, at least one text and one negative.
    pub(crate) fn new(scale: Scale, texts: &[Arc<[f32]>], negatives: &[Arc<[f32]>]) -> Self {
        assert!(!texts.is_empty() && !negatives.is_empty(), "at least one text and one negative");
        let mut embeddings = Array2::zeros((0, texts[0].len()));
        for embedding in texts.iter().chain(negatives) {
            let row = ArrayView1::from(&embedding[..]);
            embeddings.push_row(row).expect("embeddings are of one size");
        }
        Self { scale, texts: texts.len(), embeddings }
    }

    /// Number of texts, without the negatives.
    pub(crate) fn texts(&self) -> usize {
        self.texts
    }

    /// Relevancies `[n, texts]`, 0..1, of features `[n, D]` of unit length.
    pub(crate) fn relevancies<T: Component>(&self, features: &[T]) -> Vec<f32> {
        let Scale { temperature, bias } = self.scale;
        let size = self.embeddings.ncols();
        features
            .par_chunks(BATCH * size)
            .flat_map_iter(|batch| {
                let cosines = cosines(batch, &self.embeddings);
                let mut relevancies = Vec::with_capacity(batch.len() / size * self.texts);
                for row in cosines.chunks_exact(self.embeddings.nrows()) {
                    let (texts, negatives) = row.split_at(self.texts);
                    // The minimum over negatives is reached at the nearest one.
                    let nearest = negatives.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                    let relevancy = |cosine: &f32| {
                        1.0 / (1.0 + (temperature * (nearest - cosine) + bias).exp())
                    };
                    relevancies.extend(texts.iter().map(relevancy));
                }
                relevancies
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: Scale = Scale { temperature: 10.0, bias: 0.0 };

    fn embedding<const N: usize>(values: [f32; N]) -> Arc<[f32]> {
        values.to_vec().into()
    }

    fn prompts<const N: usize>(scale: Scale, text: [f32; N], negatives: &[[f32; N]]) -> Prompts {
        let negatives: Vec<_> = negatives.iter().copied().map(embedding).collect();
        Prompts::new(scale, &[embedding(text)], &negatives)
    }

    #[test]
    fn relevancy_is_the_minimum_over_negatives() {
        let (query, first, second) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]);
        let both_negatives = prompts(SCALE, query, &[first, second]);
        let feature = [0.8, 0.6, 0.0];
        // f·q = 0.8, f·n = 0.6 and 0.48: by hand 1 / (1 + exp(10 (0.6 - 0.8))).
        let expected = 1.0 / (1.0 + (-2.0_f32).exp());
        assert!((both_negatives.relevancies(&feature)[0] - expected).abs() < 1e-6);
        // Negative control: without the nearer negative the relevancy differs.
        let other = prompts(SCALE, query, &[second]).relevancies(&feature)[0];
        assert!((other - 1.0 / (1.0 + (-3.2_f32).exp())).abs() < 1e-6);
        assert!((other - expected).abs() > 0.05);
        // As near to the query as to a negative; each row has its own relevancy.
        let between = [0.5_f32.sqrt(), 0.5_f32.sqrt(), 0.0];
        let rows = both_negatives.relevancies(&[between, feature].concat());
        assert!((rows[0] - 0.5).abs() < 1e-6 && (rows[1] - expected).abs() < 1e-6);
        assert!(both_negatives.relevancies::<f32>(&[]).is_empty());
    }

    #[test]
    fn the_bias_shifts_one_half() {
        let biased = |bias| {
            let scale = Scale { temperature: 10.0, bias };
            prompts(scale, [1.0, 0.0], &[[0.0, 1.0]]).relevancies(&[0.8, 0.6])[0]
        };
        // t (f·q - f·n) = 10 (0.8 - 0.6) = 2: a bias of 2 makes it one half, of 3 less.
        assert!((biased(2.0) - 0.5).abs() < 1e-6);
        assert!((biased(3.0) - 1.0 / (1.0 + 1.0_f32.exp())).abs() < 1e-6);
        // Negative control: without a bias it is the plain softmax.
        assert!((biased(0.0) - 1.0 / (1.0 + (-2.0_f32).exp())).abs() < 1e-6);
    }

    #[test]
    fn several_texts_have_the_relevancies_of_single_ones() {
        let texts = [embedding([1.0, 0.0, 0.0]), embedding([0.0, 0.6, 0.8])];
        let negatives = [embedding([0.0, 1.0, 0.0]), embedding([0.6, 0.0, 0.8])];
        let features = [[0.8, 0.6, 0.0], [0.0, 0.6, 0.8], [0.0, 1.0, 0.0]].concat();
        let together = Prompts::new(SCALE, &texts, &negatives).relevancies(&features);
        assert_eq!(together.len(), 3 * 2);
        for (at, text) in texts.iter().enumerate() {
            let alone = Prompts::new(SCALE, std::slice::from_ref(text), &negatives);
            for (row, expected) in alone.relevancies(&features).into_iter().enumerate() {
                assert!((together[row * 2 + at] - expected).abs() < 1e-6);
            }
        }
    }
}
