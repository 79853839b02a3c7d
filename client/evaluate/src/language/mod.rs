//! Queries about frames, scored against masks or boxes: the 2D protocol of the paper (§5), and the
//! same without a threshold.
//!
//! In each test frame every label is asked by its query, and its relevancy map is fetched unsmoothed
//! at frame size. A label counts in frames that show it; there its synonyms are asked, too. Against
//! boxes only peaks are scored. The value of a frame is the mean over its labels, that of the scene
//! the mean over its frames. Labels, frames and constants are in [`crate::labels`].

mod means;
mod record;

pub use record::{ClassScore, LabelMeans, LabelScore, Language, Latency, MaskMeans, MaskScore};

use crate::context::{Context, Relevancy};
use crate::error::EvaluateError;
use crate::heatmap::Heatmap;
use crate::labels::{Label, Labels, PAPER_THRESHOLD, Place, SMOOTHING, Sight, smoothing};
use crate::score::{as_released, average_precision, iou};
use crate::statistics::mean;
use crate::step::Step;
use means::{class, scene};

/// Asks for every label in every test frame.
pub(crate) async fn score(
    context: &Context<'_>,
    labels: &Labels<'_>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Language, EvaluateError> {
    let mut asker = Asker { context, bundle_threshold: 0.0, milliseconds: Vec::new() };
    let mut scores = Vec::new();
    let frames = &labels.frames;
    for (done, &index) in frames.iter().enumerate() {
        on_step(Step::Asking { done, of: frames.len() });
        let sequence = context.dataset.sequence(index);
        let sights = labels.sights.of(index)?;
        let (mut maps, mut synonyms) = (Vec::new(), Vec::new());
        for (label, sight) in labels.labels.iter().zip(&sights) {
            maps.push(asker.map(&label.query, sequence).await?);
            let others = if matches!(sight, Sight::Shown(_)) { &label.synonyms[..] } else { &[] };
            synonyms.push(asker.maps(others, sequence).await?);
        }
        let bundle_threshold = asker.bundle_threshold;
        let (labels, maps, sights, synonyms) = (&labels.labels, &maps, &sights, &synonyms);
        scores
            .extend(Frame { sequence, labels, maps, synonyms, sights, bundle_threshold }.scores());
    }
    on_step(Step::Asking { done: frames.len(), of: frames.len() });
    Ok(Language {
        file: labels.file.clone(),
        test_frames: frames.iter().map(|index| context.dataset.sequence(*index)).collect(),
        bundle_threshold: asker.bundle_threshold,
        scene: scene(&scores),
        classes: labels.labels.iter().filter_map(|label| class(&scores, label)).collect(),
        latency: Latency::of(asker.milliseconds),
        scores,
    })
}

/// Fetches relevancy maps.
struct Asker<'a> {
    context: &'a Context<'a>,
    /// The server's threshold in the last answer.
    bundle_threshold: f32,
    /// Latency of each query.
    milliseconds: Vec<f64>,
}

impl Asker<'_> {
    async fn map(&mut self, text: &str, sequence: u64) -> Result<Heatmap, EvaluateError> {
        let Relevancy { answer, heatmap, took } = self.context.relevancy(text, sequence).await?;
        self.milliseconds.push(took.as_secs_f64() * 1e3);
        self.bundle_threshold = answer.threshold;
        Ok(heatmap)
    }

    async fn maps(
        &mut self,
        texts: &[String],
        sequence: u64,
    ) -> Result<Vec<Heatmap>, EvaluateError> {
        let mut maps = Vec::with_capacity(texts.len());
        for text in texts {
            maps.push(self.map(text, sequence).await?);
        }
        Ok(maps)
    }
}

/// One test frame. Everything is in the order of the labels, and maps are not smoothed.
struct Frame<'a> {
    sequence: u64,
    labels: &'a [Label],
    maps: &'a [Heatmap],
    /// Maps of the labels' synonyms, where the frame shows the label.
    synonyms: &'a [Vec<Heatmap>],
    sights: &'a [Sight],
    bundle_threshold: f32,
}

impl Frame<'_> {
    /// Scores of the labels that the frame shows.
    fn scores(&self) -> Vec<LabelScore> {
        let smooth: Vec<Heatmap> = self.maps.iter().map(smoothed).collect();
        let best = best_of(&smooth);
        let score = |(at, sight): (usize, &Sight)| {
            let Sight::Shown(place) = sight else { return None };
            let synonyms = self.synonyms[at].iter();
            let hits = synonyms.map(|map| f64::from(u8::from(is_in_box(&smoothed(map), place))));
            let on_mask = place.mask.as_ref().map(|mask| {
                let argmax: Vec<bool> = best.iter().map(|best| *best == Some(at)).collect();
                mask_score(&self.maps[at], &smooth[at], &argmax, mask, self.bundle_threshold)
            });
            Some(LabelScore {
                sequence: self.sequence,
                label: self.labels[at].name.clone(),
                peak_in_box: is_in_box(&smooth[at], place),
                synonyms_in_box: mean(hits),
                on_mask,
            })
        };
        self.sights.iter().enumerate().filter_map(score).collect()
    }
}

fn smoothed(map: &Heatmap) -> Heatmap {
    map.smoothed(smoothing(map.width))
}

/// Whether the peak of a map lies in one of the boxes.
fn is_in_box(map: &Heatmap, place: &Place) -> bool {
    let holds = |(column, row)| place.boxes.iter().any(|bounds| bounds.holds(column, row));
    map.peak().is_some_and(holds)
}

/// Scores of a map against the label's pixels.
fn mask_score(
    map: &Heatmap,
    smooth: &Heatmap,
    argmax: &[bool],
    mask: &[bool],
    bundle_threshold: f32,
) -> MaskScore {
    let above = |map: &Heatmap, threshold: f32| -> Vec<bool> {
        map.values.iter().map(|value| *value > threshold).collect()
    };
    let is_on_mask = |(x, y): (usize, usize)| mask[y * smooth.width + x];
    MaskScore {
        share: mask.iter().filter(|is| **is).count() as f64 / mask.len() as f64,
        iou_paper: iou(&above(smooth, PAPER_THRESHOLD), mask),
        iou_unscaled: iou(&above(&map.smoothed(SMOOTHING), PAPER_THRESHOLD), mask),
        iou_bundle: iou(&above(smooth, bundle_threshold), mask),
        iou_released: iou(&as_released(map), mask),
        iou_argmax: iou(argmax, mask),
        peak_on_mask: smooth.peak().is_some_and(is_on_mask),
        average_precision: average_precision(&smooth.values, mask),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::boxes;

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

    fn labels() -> [Label; 2] {
        let label = |name: &str| Label {
            name: name.to_owned(),
            query: name.to_owned(),
            synonyms: vec!["thing".into(), "other thing".into()],
        };
        ["sofa", "lamp"].map(label)
    }

    fn shown(mask: &[bool]) -> Sight {
        Sight::Shown(Place { boxes: boxes(mask, WIDTH), mask: Some(mask.to_vec()) })
    }

    fn scored(maps: &[Heatmap], sights: &[Sight], synonyms: &[Vec<Heatmap>]) -> Vec<LabelScore> {
        let (labels, bundle_threshold) = (&labels(), 0.7);
        Frame { sequence: 3, labels, maps, synonyms, sights, bundle_threshold }.scores()
    }

    fn scores(maps: &[Heatmap], masks: &[&[bool]; 2]) -> Vec<LabelScore> {
        scored(maps, &masks.map(shown), &[vec![], vec![]])
    }

    #[test]
    fn good_maps_score_well_and_swapped_ones_badly() {
        let ((sofa, on_sofa), (lamp, on_lamp)) = (block(4, 4, 0.95), block(44, 44, 0.95));
        let good = scores(&[sofa.clone(), lamp.clone()], &[&on_sofa, &on_lamp]);
        assert_eq!(good.len(), 2);
        let on_mask = |score: &LabelScore| score.on_mask.unwrap();
        for score in &good {
            assert!(score.peak_in_box && score.synonyms_in_box.is_none(), "{score:?}");
            let score = on_mask(score);
            assert!(score.peak_on_mask, "{score:?}");
            assert!(score.average_precision > 0.85 && score.iou_paper > 0.5, "{score:?}");
            assert!(score.iou_released > 0.5 && (score.share - 0.16).abs() < 1e-9, "{score:?}");
        }
        // Where all are alike, the first label has the ground too: only the second is judged.
        assert!(on_mask(&good[1]).iou_argmax > 0.3, "{:?}", good[1]);
        let bad = scores(&[lamp, sofa], &[&on_sofa, &on_lamp]);
        for score in &bad {
            assert!(!score.peak_in_box, "{score:?}");
            let score = on_mask(score);
            assert!(!score.peak_on_mask, "{score:?}");
            assert!(score.average_precision < 0.17 && score.iou_paper < 0.05, "{score:?}");
            assert!(score.iou_released < 0.05 && score.iou_argmax < 0.05, "{score:?}");
        }
        let means = scene(&good);
        assert!(means.loc_box == 1.0 && scene(&bad).loc_box == 0.0);
    }

    #[test]
    fn labels_that_are_not_shown_do_not_count_and_missing_language_is_a_miss() {
        let ((sofa, on_sofa), (lamp, _)) = (block(4, 4, 0.9), block(44, 44, 0.9));
        let none = [vec![], vec![]];
        for other in [Sight::Hidden, Sight::Unclear] {
            let maps = [sofa.clone(), lamp.clone()];
            assert_eq!(scored(&maps, &[shown(&on_sofa), other], &none).len(), 1);
        }
        let nothing = Heatmap { values: vec![0.0; WIDTH * WIDTH], ..sofa };
        let sights = [shown(&on_sofa), Sight::Hidden];
        let found = &scored(&[nothing.clone(), nothing], &sights, &none)[0];
        let on_mask = found.on_mask.unwrap();
        assert!(!found.peak_in_box && on_mask.iou_argmax == 0.0 && on_mask.iou_paper == 0.0);
    }

    #[test]
    fn boxes_score_peaks_and_synonyms_have_their_own() {
        let ((sofa, on_sofa), (lamp, on_lamp)) = (block(4, 4, 0.9), block(44, 44, 0.9));
        let boxed = |mask: &[bool]| Sight::Shown(Place { boxes: boxes(mask, WIDTH), mask: None });
        let maps = [sofa.clone(), sofa.clone()];
        let synonyms = [vec![sofa.clone(), lamp.clone()], vec![lamp.clone(), lamp]];
        let found = scored(&maps, &[boxed(&on_sofa), boxed(&on_lamp)], &synonyms);
        let seen: Vec<_> = found.iter().map(|one| (one.peak_in_box, one.synonyms_in_box)).collect();
        assert_eq!(seen, [(true, Some(0.5)), (false, Some(1.0))]);
        assert!(found.iter().all(|score| score.on_mask.is_none()));
    }
}
