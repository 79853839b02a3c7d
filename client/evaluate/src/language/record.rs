//! Scores of queries about frames, as they are serialised.

use crate::statistics::mean;
use serde::Serialize;

/// One label in one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelScore {
    /// Number of the frame.
    pub sequence: u64,
    /// The label.
    pub label: String,
    /// Whether the peak lies in a box of the label.
    pub peak_in_box: bool,
    /// Share of the synonyms whose peak lies in a box of the label; absent without synonyms.
    pub synonyms_in_box: Option<f64>,
    /// Scores against the pixels of the label, if they are known.
    #[serde(flatten)]
    pub on_mask: Option<MaskScore>,
}

/// One label in one frame, against its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MaskScore {
    /// Share of the frame's pixels: the average precision of a constant map.
    pub share: f64,
    /// IoU of the pixels above 0.5.
    pub iou_paper: f64,
    /// The same with a filter of 20 pixels at any frame size.
    pub iou_unscaled: f64,
    /// IoU of the pixels above the bundle's threshold.
    pub iou_bundle: f64,
    /// IoU of the released script's mask.
    pub iou_released: f64,
    /// IoU of the pixels where this label has the highest relevancy of all labels.
    pub iou_argmax: f64,
    /// Whether the peak lies on the label itself.
    pub peak_on_mask: bool,
    /// Average precision.
    pub average_precision: f64,
}

impl LabelScore {
    /// Average precision, or whether the peak lies in a box if the pixels are not known: orders scores
    /// of one kind.
    pub(crate) fn quality(&self) -> f64 {
        let in_box = f64::from(u8::from(self.peak_in_box));
        self.on_mask.map_or(in_box, |score| score.average_precision)
    }
}

/// Means over the frames of a label, or over the means of all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LabelMeans {
    /// Share of peaks in a box.
    pub loc_box: f64,
    /// Share of the synonyms' peaks in a box; absent without synonyms.
    pub loc_synonyms: Option<f64>,
    /// Means of scores against masks, if there are any.
    #[serde(flatten)]
    pub masks: Option<MaskMeans>,
}

/// Means of scores against masks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MaskMeans {
    /// See [`MaskScore::share`].
    pub share: f64,
    /// Mean IoU at 0.5.
    pub miou_paper: f64,
    /// Mean IoU at 0.5 with a filter of 20 pixels at any frame size.
    pub miou_unscaled: f64,
    /// Mean IoU at the bundle's threshold.
    pub miou_bundle: f64,
    /// Mean IoU of the released script's mask.
    pub miou_released: f64,
    /// Mean IoU of the closed-set labels (argmax).
    pub miou_argmax: f64,
    /// Share of peaks on the object.
    pub loc_mask: f64,
    /// Mean average precision.
    pub average_precision: f64,
}

/// Mean scores of a label.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClassScore {
    /// The label.
    pub label: String,
    /// The text that asked for it.
    pub query: String,
    /// Number of test frames that show it.
    pub frames: usize,
    /// Means over these frames.
    #[serde(flatten)]
    pub means: LabelMeans,
}

impl LabelMeans {
    /// Average precision, or the share of peaks in a box if there are no masks: orders means of one
    /// kind.
    pub(crate) fn quality(&self) -> f64 {
        self.masks.map_or(self.loc_box, |masks| masks.average_precision)
    }
}

/// Latency of queries about frames. The first query about a view renders and decodes it; later ones
/// use the cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Latency {
    /// Number of queries.
    pub questions: usize,
    /// Median, milliseconds.
    pub p50_ms: f64,
    /// 99th percentile, milliseconds.
    pub p99_ms: f64,
    /// Mean, milliseconds.
    pub mean_ms: f64,
}

impl Latency {
    /// Statistics of the latencies of all queries, milliseconds.
    pub(super) fn of(mut milliseconds: Vec<f64>) -> Self {
        milliseconds.sort_by(f64::total_cmp);
        // Nearest rank.
        let within = |share: f64| {
            let rank = (share * milliseconds.len() as f64).ceil().max(1.0) as usize;
            milliseconds.get(rank - 1).copied().unwrap_or_default()
        };
        Self {
            questions: milliseconds.len(),
            p50_ms: within(0.5),
            p99_ms: within(0.99),
            mean_ms: mean(milliseconds.iter().copied()).unwrap_or_default(),
        }
    }
}

/// Scores of queries about frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Language {
    /// Name of the file that the labels are from; absent: the data set's masks.
    pub file: Option<String>,
    /// Numbers of the test frames.
    pub test_frames: Vec<u64>,
    /// The server's default threshold.
    pub bundle_threshold: f32,
    /// Means over all test frames.
    pub scene: LabelMeans,
    /// Means of each label that the test frames show.
    pub classes: Vec<ClassScore>,
    /// Latency that the client sees.
    pub latency: Latency,
    /// Score of each label in each frame.
    pub scores: Vec<LabelScore>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_are_ranks() {
        let found = Latency::of((1..=200).rev().map(f64::from).collect());
        assert_eq!((found.p50_ms, found.p99_ms, found.mean_ms), (100.0, 198.0, 100.5));
        assert_eq!(Latency::of(vec![7.0]).p99_ms, 7.0);
        assert_eq!(Latency::of(Vec::new()), Latency::default());
    }
}
