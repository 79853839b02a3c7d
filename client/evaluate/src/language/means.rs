//! Means of scores: over the frames of a label, and over all test frames.

use super::record::{ClassScore, LabelMeans, LabelScore, MaskMeans, MaskScore};
use crate::labels::Label;
use crate::statistics::mean;

fn share(is: bool) -> f64 {
    f64::from(u8::from(is))
}

/// Means of scores; zeros if there are none.
fn label_means(scores: &[&LabelScore]) -> LabelMeans {
    let in_box = scores.iter().map(|score| share(score.peak_in_box));
    LabelMeans {
        loc_box: mean(in_box).unwrap_or_default(),
        loc_synonyms: mean(scores.iter().filter_map(|score| score.synonyms_in_box)),
        masks: mask_means(scores.iter().filter_map(|score| score.on_mask).map(single)),
    }
}

/// The means of one score.
fn single(score: MaskScore) -> MaskMeans {
    MaskMeans {
        share: score.share,
        miou_paper: score.iou_paper,
        miou_unscaled: score.iou_unscaled,
        miou_bundle: score.iou_bundle,
        miou_released: score.iou_released,
        miou_argmax: score.iou_argmax,
        loc_mask: share(score.peak_on_mask),
        average_precision: score.average_precision,
    }
}

/// The mean of means, field by field; `None` if there are none.
fn mask_means(masks: impl Iterator<Item = MaskMeans>) -> Option<MaskMeans> {
    let masks: Vec<MaskMeans> = masks.collect();
    let of = |value: fn(&MaskMeans) -> f64| mean(masks.iter().map(value));
    Some(MaskMeans {
        share: of(|one| one.share)?,
        miou_paper: of(|one| one.miou_paper)?,
        miou_unscaled: of(|one| one.miou_unscaled)?,
        miou_bundle: of(|one| one.miou_bundle)?,
        miou_released: of(|one| one.miou_released)?,
        miou_argmax: of(|one| one.miou_argmax)?,
        loc_mask: of(|one| one.loc_mask)?,
        average_precision: of(|one| one.average_precision)?,
    })
}

/// The means of a label; `None` if no frame shows it.
pub(super) fn class(scores: &[LabelScore], label: &Label) -> Option<ClassScore> {
    let own: Vec<&LabelScore> = scores.iter().filter(|score| score.label == label.name).collect();
    (!own.is_empty()).then(|| ClassScore {
        label: label.name.clone(),
        query: label.query.clone(),
        frames: own.len(),
        means: label_means(&own),
    })
}

/// The mean over frames of the means over a frame's labels.
pub(super) fn scene(scores: &[LabelScore]) -> LabelMeans {
    let frames: Vec<LabelMeans> = scores
        .chunk_by(|a, b| a.sequence == b.sequence)
        .map(|frame| label_means(&frame.iter().collect::<Vec<_>>()))
        .collect();
    LabelMeans {
        loc_box: mean(frames.iter().map(|frame| frame.loc_box)).unwrap_or_default(),
        loc_synonyms: mean(frames.iter().filter_map(|frame| frame.loc_synonyms)),
        masks: mask_means(frames.iter().filter_map(|frame| frame.masks)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(sequence: u64, iou_paper: f64) -> LabelScore {
        LabelScore {
            sequence,
            label: "sofa".into(),
            peak_in_box: true,
            synonyms_in_box: None,
            on_mask: Some(MaskScore {
                share: 0.1,
                iou_paper,
                iou_unscaled: 0.0,
                iou_bundle: 0.0,
                iou_released: 0.0,
                iou_argmax: 0.0,
                peak_on_mask: false,
                average_precision: 0.0,
            }),
        }
    }

    #[test]
    fn frames_have_equal_weight_whatever_their_labels() {
        let scores = [score(1, 1.0), score(1, 0.0), score(2, 1.0)];
        let label = |name: &str| Label { name: name.into(), query: name.into(), synonyms: vec![] };
        assert_eq!(scene(&scores).masks.unwrap().miou_paper, 0.75);
        let sofa = class(&scores, &label("sofa")).unwrap();
        assert_eq!(sofa.means.masks.unwrap().miou_paper, 2.0 / 3.0);
        assert_eq!(class(&scores, &label("lamp")), None);
    }

    #[test]
    fn boxes_have_no_iou_and_synonyms_count_where_there_are_any() {
        let boxed = |sequence, peak_in_box, synonyms_in_box| LabelScore {
            peak_in_box,
            synonyms_in_box,
            on_mask: None,
            ..score(sequence, 0.0)
        };
        let found =
            scene(&[boxed(1, true, Some(0.5)), boxed(1, false, None), boxed(2, true, Some(1.0))]);
        assert_eq!(found, LabelMeans { loc_box: 0.75, loc_synonyms: Some(0.75), masks: None });
        // Negative control: a mask in one frame is enough.
        assert!(scene(&[boxed(1, true, None), score(2, 0.4)]).masks.is_some());
        assert_eq!(scene(&[]), LabelMeans::default());
    }
}
