//! Queries about frames, scored against masks: the 2D protocol of the paper (§5), and the same
//! without a threshold.
//!
//! The labels are the classes with most pixels, walls, floor and ceiling included. The test frames
//! are evenly spaced over the tracked frames that are no keyframe. In each of them every label is
//! asked by its class name, and its relevancy map is fetched unsmoothed at frame size. A label
//! counts in frames that show enough pixels of it. The value of a frame is the mean over its
//! labels, that of the scene the mean over its frames. The constants are in [`crate::labels`].

use crate::context::{Context, Relevancy};
use crate::error::EvaluateError;
use crate::heatmap::Heatmap;
use crate::labels::{LEAST_PIXELS, PAPER_THRESHOLD, SMOOTHING, shows, smoothing};
use crate::score::{as_released, average_precision, boxes, iou};
use crate::statistics::mean;
use crate::step::Step;
use lexsplat_client::dataset::Truth;
use serde::Serialize;

/// One label in one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelScore {
    /// Number of the frame.
    pub sequence: u64,
    /// The class.
    pub label: String,
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
    /// Whether the peak lies in a box of the label.
    pub peak_in_box: bool,
    /// Whether the peak lies on the label itself.
    pub peak_on_mask: bool,
    /// Average precision.
    pub average_precision: f64,
}

/// Means over the frames of a class, or over the means of all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LabelMeans {
    /// See [`LabelScore::share`].
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
    /// Share of peaks in a box.
    pub loc_box: f64,
    /// Share of peaks on the object.
    pub loc_mask: f64,
    /// Mean average precision.
    pub average_precision: f64,
}

/// Mean scores of a class.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClassScore {
    /// The class; its name is the query.
    pub label: String,
    /// Number of test frames that show it.
    pub frames: usize,
    /// Means over these frames.
    #[serde(flatten)]
    pub means: LabelMeans,
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
    fn of(mut milliseconds: Vec<f64>) -> Self {
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
    /// Numbers of the test frames.
    pub test_frames: Vec<u64>,
    /// The server's default threshold.
    pub bundle_threshold: f32,
    /// Means over all test frames.
    pub scene: LabelMeans,
    /// Means of each class that the test frames show.
    pub classes: Vec<ClassScore>,
    /// Latency that the client sees.
    pub latency: Latency,
    /// Score of each label in each frame.
    pub scores: Vec<LabelScore>,
}

/// Asks for every label in every frame (positions in the data set).
pub(crate) async fn score(
    context: &Context<'_>,
    truth: &dyn Truth,
    labels: &[String],
    frames: &[usize],
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Language, EvaluateError> {
    let (mut scores, mut bundle_threshold, mut milliseconds) = (Vec::new(), 0.0, Vec::new());
    for (done, &index) in frames.iter().enumerate() {
        on_step(Step::Asking { done, of: frames.len() });
        let sequence = context.dataset.sequence(index);
        let mut maps = Vec::with_capacity(labels.len());
        for label in labels {
            let Relevancy { answer, heatmap, took } = context.relevancy(label, sequence).await?;
            milliseconds.push(took.as_secs_f64() * 1e3);
            bundle_threshold = answer.threshold;
            maps.push(heatmap);
        }
        let mask = truth.mask(index)?;
        let masks: Vec<Vec<bool>> = labels.iter().map(|label| shows(&mask, truth, label)).collect();
        let frame = Frame { sequence, labels, maps: &maps, masks: &masks, bundle_threshold };
        scores.extend(frame.scores());
    }
    on_step(Step::Asking { done: frames.len(), of: frames.len() });
    Ok(Language {
        test_frames: frames.iter().map(|index| context.dataset.sequence(*index)).collect(),
        bundle_threshold,
        scene: scene(&scores),
        classes: labels.iter().filter_map(|label| class(&scores, label)).collect(),
        latency: Latency::of(milliseconds),
        scores,
    })
}

/// One test frame: unsmoothed relevancy maps and masks in the order of the labels.
struct Frame<'a> {
    sequence: u64,
    labels: &'a [String],
    maps: &'a [Heatmap],
    masks: &'a [Vec<bool>],
    bundle_threshold: f32,
}

impl Frame<'_> {
    /// Scores of the labels that the frame shows.
    fn scores(&self) -> Vec<LabelScore> {
        let smooth: Vec<Heatmap> =
            self.maps.iter().map(|map| map.smoothed(smoothing(map.width))).collect();
        let best = best_of(&smooth);
        let counted = |at: &usize| self.masks[*at].iter().filter(|is| **is).count();
        let seen = (0..self.labels.len()).filter(|at| counted(at) >= LEAST_PIXELS);
        seen.map(|at| {
            let (mask, map) = (&self.masks[at], &smooth[at]);
            let above = |map: &Heatmap, threshold: f32| -> Vec<bool> {
                map.values.iter().map(|value| *value > threshold).collect()
            };
            let argmax: Vec<bool> = best.iter().map(|best| *best == Some(at)).collect();
            let peak = map.peak();
            let in_box = |(column, row)| {
                boxes(mask, map.width).iter().any(|bounds| bounds.holds(column, row))
            };
            LabelScore {
                sequence: self.sequence,
                label: self.labels[at].clone(),
                share: counted(&at) as f64 / mask.len() as f64,
                iou_paper: iou(&above(map, PAPER_THRESHOLD), mask),
                iou_unscaled: iou(
                    &above(&self.maps[at].smoothed(SMOOTHING), PAPER_THRESHOLD),
                    mask,
                ),
                iou_bundle: iou(&above(map, self.bundle_threshold), mask),
                iou_released: iou(&as_released(&self.maps[at]), mask),
                iou_argmax: iou(&argmax, mask),
                peak_in_box: peak.is_some_and(in_box),
                peak_on_mask: peak.is_some_and(|(x, y)| mask[y * map.width + x]),
                average_precision: average_precision(&map.values, mask),
            }
        })
        .collect()
    }
}

/// The label with the highest relevancy at each pixel; `None` where all are 0.
fn best_of(maps: &[Heatmap]) -> Vec<Option<usize>> {
    let pixels = maps.first().map_or(0, |map| map.values.len());
    let best = |pixel: usize| {
        let values = maps.iter().map(|map| map.values[pixel]).enumerate();
        let best = values.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        best.filter(|(_, value)| *value > 0.0).map(|(at, _)| at)
    };
    (0..pixels).map(best).collect()
}

/// Means of scores; zeros if there are none.
fn means(scores: &[&LabelScore]) -> LabelMeans {
    let of = |value: fn(&LabelScore) -> f64| {
        mean(scores.iter().map(|score| value(score))).unwrap_or_default()
    };
    let share = |is: bool| f64::from(u8::from(is));
    LabelMeans {
        share: of(|score| score.share),
        miou_paper: of(|score| score.iou_paper),
        miou_unscaled: of(|score| score.iou_unscaled),
        miou_bundle: of(|score| score.iou_bundle),
        miou_released: of(|score| score.iou_released),
        miou_argmax: of(|score| score.iou_argmax),
        loc_box: mean(scores.iter().map(|score| share(score.peak_in_box))).unwrap_or_default(),
        loc_mask: mean(scores.iter().map(|score| share(score.peak_on_mask))).unwrap_or_default(),
        average_precision: of(|score| score.average_precision),
    }
}

fn class(scores: &[LabelScore], label: &str) -> Option<ClassScore> {
    let own: Vec<&LabelScore> = scores.iter().filter(|score| score.label == label).collect();
    (!own.is_empty()).then(|| ClassScore {
        label: label.to_owned(),
        frames: own.len(),
        means: means(&own),
    })
}

/// The mean over frames of the means over a frame's labels.
fn scene(scores: &[LabelScore]) -> LabelMeans {
    let frames: Vec<LabelMeans> = scores
        .chunk_by(|a, b| a.sequence == b.sequence)
        .map(|frame| means(&frame.iter().collect::<Vec<_>>()))
        .collect();
    let of = |value: fn(&LabelMeans) -> f64| mean(frames.iter().map(value)).unwrap_or_default();
    LabelMeans {
        share: of(|frame| frame.share),
        miou_paper: of(|frame| frame.miou_paper),
        miou_unscaled: of(|frame| frame.miou_unscaled),
        miou_bundle: of(|frame| frame.miou_bundle),
        miou_released: of(|frame| frame.miou_released),
        miou_argmax: of(|frame| frame.miou_argmax),
        loc_box: of(|frame| frame.loc_box),
        loc_mask: of(|frame| frame.loc_mask),
        average_precision: of(|frame| frame.average_precision),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 80;

    /// A plane and the mask of its block of `side` pixels at a place.
    fn block(left: usize, top: usize, value: f32) -> (Heatmap, Vec<bool>) {
        let side = 32;
        let inside = |at: usize| {
            (left..left + side).contains(&(at % WIDTH)) && (top..top + side).contains(&(at / WIDTH))
        };
        let mask: Vec<bool> = (0..WIDTH * WIDTH).map(inside).collect();
        let values = mask.iter().map(|is| if *is { value } else { 0.1 }).collect();
        (Heatmap { width: WIDTH, values }, mask)
    }

    fn scores(maps: &[Heatmap], masks: &[Vec<bool>]) -> Vec<LabelScore> {
        let labels = ["sofa".to_owned(), "lamp".to_owned()];
        Frame { sequence: 3, labels: &labels, maps, masks, bundle_threshold: 0.7 }.scores()
    }

    #[test]
    fn good_maps_score_well_and_swapped_ones_badly() {
        let ((sofa, on_sofa), (lamp, on_lamp)) = (block(4, 4, 0.95), block(44, 44, 0.95));
        let good = scores(&[sofa.clone(), lamp.clone()], &[on_sofa.clone(), on_lamp.clone()]);
        assert_eq!(good.len(), 2);
        for score in &good {
            assert!(score.peak_in_box && score.peak_on_mask, "{score:?}");
            assert!(score.average_precision > 0.85 && score.iou_paper > 0.5, "{score:?}");
            assert!(score.iou_released > 0.5 && (score.share - 0.16).abs() < 1e-9, "{score:?}");
        }
        // Where all are alike, the first label has the ground too: only the second is judged.
        assert!(good[1].iou_argmax > 0.3, "{:?}", good[1]);
        let bad = scores(&[lamp, sofa], &[on_sofa, on_lamp]);
        for score in &bad {
            assert!(!score.peak_in_box && !score.peak_on_mask, "{score:?}");
            assert!(score.average_precision < 0.17 && score.iou_paper < 0.05, "{score:?}");
            assert!(score.iou_released < 0.05 && score.iou_argmax < 0.05, "{score:?}");
        }
        let means = scene(&good);
        assert!(means.loc_box == 1.0 && scene(&bad).loc_box == 0.0);
    }

    #[test]
    fn labels_with_few_pixels_do_not_count_and_missing_language_is_a_miss() {
        let ((sofa, on_sofa), (lamp, _)) = (block(4, 4, 0.9), block(44, 44, 0.9));
        let mut speck = vec![false; WIDTH * WIDTH];
        speck[..LEAST_PIXELS - 1].fill(true);
        assert_eq!(scores(&[sofa.clone(), lamp], &[on_sofa.clone(), speck]).len(), 1);
        let nothing = Heatmap { values: vec![0.0; WIDTH * WIDTH], ..sofa };
        let found = &scores(&[nothing.clone(), nothing], &[on_sofa, vec![false; WIDTH * WIDTH]])[0];
        assert!(!found.peak_in_box && found.iou_argmax == 0.0 && found.iou_paper == 0.0);
    }

    #[test]
    fn frames_have_equal_weight_whatever_their_labels() {
        let score = |sequence, iou_paper| LabelScore {
            sequence,
            label: "sofa".into(),
            share: 0.1,
            iou_paper,
            iou_unscaled: 0.0,
            iou_bundle: 0.0,
            iou_released: 0.0,
            iou_argmax: 0.0,
            peak_in_box: true,
            peak_on_mask: false,
            average_precision: 0.0,
        };
        let scores = [score(1, 1.0), score(1, 0.0), score(2, 1.0)];
        assert_eq!(scene(&scores).miou_paper, 0.75);
        assert_eq!(class(&scores, "sofa").unwrap().means.miou_paper, 2.0 / 3.0);
        assert_eq!(class(&scores, "lamp"), None);
    }

    #[test]
    fn latencies_are_ranks() {
        let found = Latency::of((1..=200).rev().map(f64::from).collect());
        assert_eq!((found.p50_ms, found.p99_ms, found.mean_ms), (100.0, 198.0, 100.5));
        assert_eq!(Latency::of(vec![7.0]).p99_ms, 7.0);
        assert_eq!(Latency::of(Vec::new()), Latency::default());
    }
}
