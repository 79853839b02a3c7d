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
    let masks: Vec<&MaskScore> = scores.iter().filter_map(|score| score.on_mask.as_ref()).collect();
    let of = |value: fn(&MaskScore) -> f64| {
        mean(masks.iter().map(|score| value(score))).unwrap_or_default()
    };
    LabelMeans {
        loc_box: mean(in_box).unwrap_or_default(),
        loc_synonyms: mean(scores.iter().filter_map(|score| score.synonyms_in_box)),
        masks: (!masks.is_empty()).then(|| MaskMeans {
            share: of(|score| score.share),
            miou_paper: of(|score| score.iou_paper),
            miou_unscaled: of(|score| score.iou_unscaled),
            miou_bundle: of(|score| score.iou_bundle),
            miou_released: of(|score| score.iou_released),
            miou_argmax: of(|score| score.iou_argmax),
            loc_mask: of(|score| share(score.peak_on_mask)),
            average_precision: of(|score| score.average_precision),
        }),
    }
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
    let masks: Vec<MaskMeans> = frames.iter().filter_map(|frame| frame.masks).collect();
    let of = |value: fn(&MaskMeans) -> f64| mean(masks.iter().map(value)).unwrap_or_default();
    LabelMeans {
        loc_box: mean(frames.iter().map(|frame| frame.loc_box)).unwrap_or_default(),
        loc_synonyms: mean(frames.iter().filter_map(|frame| frame.loc_synonyms)),
        masks: (!masks.is_empty()).then(|| MaskMeans {
            share: of(|frame| frame.share),
            miou_paper: of(|frame| frame.miou_paper),
            miou_unscaled: of(|frame| frame.miou_unscaled),
            miou_bundle: of(|frame| frame.miou_bundle),
            miou_released: of(|frame| frame.miou_released),
            miou_argmax: of(|frame| frame.miou_argmax),
            loc_mask: of(|frame| frame.loc_mask),
            average_precision: of(|frame| frame.average_precision),
        }),
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
