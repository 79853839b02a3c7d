//! Settings of the queries, section `[query]`.

use super::limits::MAX_VIEW_SIDE;
use crate::pipeline::range::{MAX_COUNT, MAX_KEPT, OutOfRange, above, at_least, within};
use serde::{Deserialize, Serialize};

/// Width of the images for which the paper's mean filter has 20 pixels.
const SMOOTHED_COLUMNS: f32 = 1200.0;
/// The largest cache of decoded features: a tebibyte.
const MAX_CACHE_MIB: usize = 1 << 20;

/// How questions are answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QueryConfig {
    /// Questions of one client that may wait; further ones are refused.
    pub queue: usize,
    /// Side of the mean filter over a relevancy map of 1200 columns, pixels. It is scaled in
    /// proportion for other widths.
    pub smoothing_pixels: u32,
    /// Relevancy above which a pixel or a Gaussian counts, 0..1; `None`: the bundle's.
    pub threshold: Option<f32>,
    /// Bias of the relevancy: the lead in cosine over the nearest negative that gives 0.5, times
    /// the temperature. `None`: the bundle's, which suits the features of its own image encoder.
    pub bias: Option<f32>,
    /// Columns at which the codes of a view are rendered and decoded. A narrower view keeps its
    /// own width.
    pub code_columns: u32,
    /// Texts whose embeddings are cached.
    pub cached_texts: usize,
    /// Memory for the decoded features of one map, MiB. A larger map is decoded at every question.
    pub feature_cache_mib: usize,
    /// Objects: radius of the clustering (eps of DBSCAN) between the surfaces of two Gaussians,
    /// metres.
    pub cluster_metres: f32,
    /// Objects: Gaussians of the smallest cluster. As many Gaussians must reach a relevancy for it
    /// to count for the confidence.
    pub cluster_points: usize,
    /// Objects: least score, as a share of the way from the threshold to the best object's score
    /// (in logits).
    pub object_score: f32,
    /// Objects: least number of Gaussians, as a share of the largest object's.
    pub object_size: f32,
}

impl Default for QueryConfig {
    fn default() -> Self {
        Self {
            queue: 64,
            smoothing_pixels: 20,
            threshold: None,
            bias: None,
            code_columns: 200,
            cached_texts: 1024,
            feature_cache_mib: 512,
            cluster_metres: 0.15,
            cluster_points: 10,
            object_score: 0.5,
            object_size: 0.02,
        }
    }
}

impl QueryConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("query.queue", self.queue, 1..=MAX_KEPT)?;
        within("query.smoothing_pixels", self.smoothing_pixels, 0..=MAX_VIEW_SIDE)?;
        if let Some(threshold) = self.threshold {
            within("query.threshold", threshold, 0.0..=1.0)?;
        }
        if let Some(bias) = self.bias {
            at_least("query.bias", bias, 0.0)?;
        }
        within("query.code_columns", self.code_columns, 1..=MAX_VIEW_SIDE)?;
        within("query.cached_texts", self.cached_texts, 1..=MAX_KEPT)?;
        within("query.feature_cache_mib", self.feature_cache_mib, 0..=MAX_CACHE_MIB)?;
        above("query.cluster_metres", self.cluster_metres, 0.0)?;
        within("query.cluster_points", self.cluster_points, 1..=MAX_COUNT)?;
        within("query.object_score", self.object_score, 0.0..=1.0)?;
        within("query.object_size", self.object_size, 0.0..=1.0)
    }

    /// Side of the mean filter for a view of this many columns, pixels, at least 1: `requested`,
    /// or else the configured side in proportion to the width.
    pub(super) fn smoothing(&self, requested: Option<u32>, columns: u32) -> usize {
        let scaled = self.smoothing_pixels as f32 * columns as f32 / SMOOTHED_COLUMNS;
        requested.unwrap_or(scaled.round() as u32).max(1) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_number_is_checked() {
        assert_checks(
            "query",
            QueryConfig::check,
            &[
                ("query.queue", |c| c.queue = 0, |c| c.queue = 1),
                (
                    "query.smoothing_pixels",
                    |c| c.smoothing_pixels = MAX_VIEW_SIDE + 1,
                    |c| c.smoothing_pixels = 0,
                ),
                ("query.threshold", |c| c.threshold = Some(1.01), |c| c.threshold = Some(1.0)),
                ("query.threshold", |c| c.threshold = Some(f32::NAN), |c| c.threshold = None),
                ("query.bias", |c| c.bias = Some(-0.1), |c| c.bias = Some(0.0)),
                ("query.bias", |c| c.bias = Some(f32::INFINITY), |c| c.bias = None),
                ("query.code_columns", |c| c.code_columns = 0, |c| c.code_columns = 1),
                ("query.cached_texts", |c| c.cached_texts = 0, |c| c.cached_texts = 1),
                (
                    "query.feature_cache_mib",
                    |c| c.feature_cache_mib = MAX_CACHE_MIB + 1,
                    |c| c.feature_cache_mib = 0,
                ),
                ("query.cluster_metres", |c| c.cluster_metres = 0.0, |c| c.cluster_metres = 1e-3),
                ("query.cluster_points", |c| c.cluster_points = 0, |c| c.cluster_points = 1),
                ("query.object_score", |c| c.object_score = -0.1, |c| c.object_score = 0.0),
                ("query.object_score", |c| c.object_score = 1.1, |c| c.object_score = 1.0),
                ("query.object_size", |c| c.object_size = f32::NAN, |c| c.object_size = 0.0),
            ],
            &[],
        );
    }

    #[test]
    fn the_filter_is_in_proportion_to_the_width_of_the_view() {
        let config = QueryConfig::default();
        let sides = [1200, 600, 320, 10].map(|columns| config.smoothing(None, columns));
        assert_eq!(sides, [20, 10, 5, 1]);
        // A requested side is in pixels.
        assert_eq!([320, 1200].map(|columns| config.smoothing(Some(7), columns)), [7, 7]);
    }
}
