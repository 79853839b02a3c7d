//! Scores of one relevancy map `[height * width]` (row-major) against one mask: IoU and average
//! precision; boxes of masks.
//!
//! Average precision is the mean precision over recall steps, sum of (R_n - R_(n-1)) P_n, where
//! pixels of equal relevancy enter together. It needs no threshold; a constant map scores the
//! object's share of the frame. [`as_released`] is the mask of the paper's released script.

use crate::heatmap::Heatmap;

/// The bounding box of a connected region, pixels, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// Left and right.
    pub columns: [usize; 2],
    /// Top and bottom.
    pub rows: [usize; 2],
}

impl Bounds {
    /// Whether a pixel is inside.
    pub fn holds(&self, column: usize, row: usize) -> bool {
        (self.columns[0]..=self.columns[1]).contains(&column)
            && (self.rows[0]..=self.rows[1]).contains(&row)
    }
}

/// Side of the released script's mean filter.
const RELEASED_SMOOTHING: usize = 30;
/// The released script's threshold on the map scaled to 0..1.
const RELEASED_THRESHOLD: f32 = 0.75;
/// Side of the released script's majority filter.
const RELEASED_MAJORITY: usize = 7;

/// Intersection over union; 0 if both masks are empty.
///
/// # Panics
/// If the lengths differ.
pub fn iou(found: &[bool], truth: &[bool]) -> f64 {
    assert_eq!(found.len(), truth.len(), "masks of one size");
    let count = |test: fn(bool, bool) -> bool| {
        found.iter().zip(truth).filter(|(found, truth)| test(**found, **truth)).count()
    };
    let (both, any) = (count(|a, b| a && b), count(|a, b| a || b));
    if any == 0 { 0.0 } else { both as f64 / any as f64 }
}

/// Average precision of the relevancies for the pixels of the mask; 0 if the mask is empty.
///
/// # Panics
/// If the lengths differ.
pub fn average_precision(values: &[f32], truth: &[bool]) -> f64 {
    assert_eq!(values.len(), truth.len(), "a relevancy for each pixel");
    let mut order: Vec<(f32, bool)> = values.iter().copied().zip(truth.iter().copied()).collect();
    order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let all = truth.iter().filter(|is| **is).count();
    let (mut right, mut seen, mut sum) = (0_usize, 0_usize, 0.0);
    for equals in order.chunk_by(|a, b| a.0 == b.0) {
        let new = equals.iter().filter(|(_, is)| *is).count();
        right += new;
        seen += equals.len();
        sum += new as f64 * right as f64 / seen as f64;
    }
    if all == 0 { 0.0 } else { sum / all as f64 }
}

/// The boxes of a mask: one for each 8-connected region.
pub fn boxes(mask: &[bool], width: usize) -> Vec<Bounds> {
    let height = mask.len() / width;
    let mut seen = vec![false; mask.len()];
    let mut found = Vec::new();
    for start in 0..mask.len() {
        if !mask[start] || seen[start] {
            continue;
        }
        let (column, row) = (start % width, start / width);
        let mut bounds = Bounds { columns: [column; 2], rows: [row; 2] };
        let mut open = vec![start];
        seen[start] = true;
        while let Some(at) = open.pop() {
            let (column, row) = (at % width, at / width);
            bounds.columns = [bounds.columns[0].min(column), bounds.columns[1].max(column)];
            bounds.rows = [bounds.rows[0].min(row), bounds.rows[1].max(row)];
            for y in row.saturating_sub(1)..(row + 2).min(height) {
                for x in column.saturating_sub(1)..(column + 2).min(width) {
                    let next = y * width + x;
                    if mask[next] && !seen[next] {
                        seen[next] = true;
                        open.push(next);
                    }
                }
            }
        }
        found.push(bounds);
    }
    found
}

/// The mask that the paper's released script makes of an unsmoothed map: the mean of the map and
/// the smoothed map, scaled to 0..1 over the frame, above 0.75, then a 7x7 majority filter in which
/// a tie is false.
pub fn as_released(relevancy: &Heatmap) -> Vec<bool> {
    let smooth = relevancy.smoothed(RELEASED_SMOOTHING);
    let mixed = relevancy.values.iter().zip(&smooth.values).map(|(a, b)| (a + b) / 2.0);
    let mixed: Vec<f32> = mixed.collect();
    let (low, high) =
        mixed.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
    let above = |v: &f32| (v - low) / (high - low) > RELEASED_THRESHOLD;
    majority(&mixed.iter().map(above).collect::<Vec<_>>(), relevancy.width)
}

fn majority(mask: &[bool], width: usize) -> Vec<bool> {
    let height = mask.len() / width;
    let reach = RELEASED_MAJORITY / 2;
    let mut out = Vec::with_capacity(mask.len());
    for row in 0..height {
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(height);
        for column in 0..width {
            let columns = column.saturating_sub(reach)..(column + reach + 1).min(width);
            let of = rows.len() * columns.len();
            let line =
                |y: usize| mask[y * width..][columns.clone()].iter().filter(|is| **is).count();
            out.push(2 * rows.clone().map(line).sum::<usize>() > of);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_and_iou_are_those_of_scikit_learn() {
        // i = arange(200); scores (i * 37 % 11) / 11, truth i % 7 < 2: average_precision_score and
        // jaccard_score(truth, scores > 0.5) of scikit-learn.
        let values: Vec<f32> = (0..200).map(|i| (i * 37 % 11) as f32 / 11.0).collect();
        let truth: Vec<bool> = (0..200).map(|i| i % 7 < 2).collect();
        let found = average_precision(&values, &truth);
        assert!((found - 0.279_763_554_471_154_1).abs() < 1e-12, "{found}");
        let above: Vec<bool> = values.iter().map(|value| *value > 0.5).collect();
        assert!((iou(&above, &truth) - 0.213_114_754_098_360_65).abs() < 1e-12);
    }

    #[test]
    fn a_constant_map_scores_the_share_and_a_perfect_one_scores_1() {
        let truth: Vec<bool> = (0..40).map(|i| i < 10).collect();
        let perfect: Vec<f32> = truth.iter().map(|is| f32::from(u8::from(*is))).collect();
        let inverted: Vec<f32> = perfect.iter().map(|value| 1.0 - value).collect();
        assert_eq!(average_precision(&perfect, &truth), 1.0);
        assert_eq!(average_precision(&[0.3; 40], &truth), 0.25);
        assert_eq!(average_precision(&inverted, &truth), 0.25);
        assert_eq!(average_precision(&perfect, &[false; 40]), 0.0);
        // By hand: right, wrong, right: (1/1 + 2/3) / 2.
        let by_hand = average_precision(&[0.9, 0.8, 0.7], &[true, false, true]);
        assert!((by_hand - 5.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn masks_overlap_by_hand() {
        let (a, b) = ([true, true, false, false], [false, true, true, false]);
        assert!((iou(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(
            (iou(&a, &a), iou(&a, &[false; 4]), iou(&[false; 4], &[false; 4])),
            (1.0, 0.0, 0.0)
        );
    }

    #[test]
    fn regions_have_boxes_and_corners_touch() {
        #[rustfmt::skip]
        let mask = [
            1, 0, 0, 1, 1,
            0, 1, 0, 0, 1,
            0, 0, 0, 0, 0,
            1, 0, 0, 0, 0,
        ].map(|v| v == 1);
        let found = boxes(&mask, 5);
        let bounds = |columns, rows| Bounds { columns, rows };
        assert_eq!(found, [bounds([0, 1], [0, 1]), bounds([3, 4], [0, 1]), bounds([0, 0], [3, 3])]);
        assert!(found[1].holds(3, 1), "a box holds more than its region");
        assert!(!found[1].holds(2, 1) && !found[1].holds(3, 2));
    }

    #[test]
    fn the_released_mask_keeps_the_top_quarter_and_drops_specks() {
        let mut values = vec![0.2; 60 * 60];
        for (at, value) in values.iter_mut().enumerate() {
            if (20..40).contains(&(at % 60)) && (20..40).contains(&(at / 60)) {
                *value = 0.6;
            }
        }
        values[5 * 60 + 5] = 0.6;
        let found = as_released(&Heatmap { width: 60, values });
        assert!(found[30 * 60 + 30], "the middle of the block");
        assert!(!found[5 * 60 + 5], "a speck");
        assert!(!found[50 * 60 + 50], "the ground");
        // A flat map has no top.
        assert!(!as_released(&Heatmap { width: 60, values: vec![0.4; 3600] }).contains(&true));
    }
}
