//! Labels of a segmentation: the most relevant of several texts.
//!
//! Label k is the k-th text, from 1. Label 0 is none: no relevancy is above the threshold.

use super::answer::{LabelImage, LabelledPoint, Segmentation, Timing};
use super::relevancy::RelevancyMap;
use rayon::prelude::*;

/// The results of a segmentation, in a view or in space.
pub(super) struct Labels {
    pub coverage: f32,
    /// For each text, the share of the pixels or of the Gaussians with its label.
    pub shares: Vec<f32>,
    pub image: Option<LabelImage>,
    pub points: Option<Vec<LabelledPoint>>,
}

impl Labels {
    /// The answer of a revision.
    pub(super) fn into_segmentation(
        self,
        revision: u64,
        threshold: f32,
        timing: Timing,
    ) -> Segmentation {
        let Self { coverage, shares, image, points } = self;
        Segmentation { revision, coverage, threshold, shares, image, points, timing }
    }
}

/// Label and relevancy of the most relevant text, from the relevancies of all texts.
pub(super) fn best_label(relevancies: impl Iterator<Item = f32>, threshold: f32) -> (u8, f32) {
    let better = |best: (u8, f32), (at, score): (usize, f32)| {
        if score > best.1 { (at as u8 + 1, score) } else { best }
    };
    // Less than any relevancy, so that a single text with a relevancy of 0 is the best one.
    let (label, score) = relevancies.enumerate().fold((0, -1.0), better);
    (if score > threshold { label } else { 0 }, score.max(0.0))
}

/// The label of each pixel, from the relevancy map of each text; all maps are of one size.
pub(super) fn pixel_labels(maps: &[RelevancyMap], threshold: f32) -> Vec<u8> {
    let pixels = maps.first().map_or(0, |map| map.values.len());
    let label = |at: usize| best_label(maps.iter().map(|map| map.values[at]), threshold).0;
    (0..pixels).into_par_iter().map(label).collect()
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

    #[test]
    fn the_best_text_is_the_label_if_it_is_above_the_threshold() {
        let label =
            |relevancies: [f32; 2], threshold| best_label(relevancies.into_iter(), threshold).0;
        assert_eq!(
            [label([0.9, 0.6], 0.5), label([0.1, 0.7], 0.5), label([0.2, 0.4], 0.5)],
            [1, 2, 0]
        );
        // Without a threshold each place gets a label.
        assert_eq!(label([0.2, 0.4], 0.0), 2);
        // The best relevancy is reported even without a label.
        assert_eq!(best_label([0.2, 0.4].into_iter(), 0.5), (0, 0.4));
    }

    #[test]
    fn pixels_take_the_best_label_and_shares_count_them() {
        let map = |values: [f32; 4]| RelevancyMap { width: 2, height: 2, values: values.to_vec() };
        let maps = [map([0.9, 0.2, 0.6, 0.0]), map([0.8, 0.7, 0.1, 0.0])];
        assert_eq!(pixel_labels(&maps, 0.5), [1, 2, 1, 0]);
        assert_eq!(pixel_labels(&maps, 0.65), [1, 2, 0, 0]);
        assert_eq!(pixel_labels(&maps, 0.0), [1, 2, 1, 0], "no language has no label");
        assert_eq!(shares([1, 2, 1, 0].into_iter(), 2), [0.5, 0.25]);
        assert_eq!(shares([].into_iter(), 2), [0.0, 0.0]);
    }
}
