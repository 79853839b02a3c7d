//! The labels that are asked for, and the frames and pixels that count (protocol of paper §5).

use crate::error::EvaluateError;
use lexsplat_client::dataset::{Mask, Truth};
use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};

/// Number of classes that are asked for.
pub const LABELS: usize = 10;
/// The pixels of classes are counted in every fifth frame.
pub const COUNTED_EVERY: usize = 5;
/// Number of frames that are asked about, as in the paper.
pub const TEST_FRAMES: usize = 21;
/// Fewest pixels with which a label counts in a frame.
pub const LEAST_PIXELS: usize = 60;
/// Side of the mean filter (paper), pixels of a frame of 1200 columns.
pub const SMOOTHING: usize = 20;
/// Columns of the paper's frames; on others the filter is scaled in proportion.
const PAPER_COLUMNS: usize = 1200;
/// Relevancy threshold of the paper.
pub const PAPER_THRESHOLD: f32 = 0.5;
/// Side of the mean filter on a frame, pixels.
pub fn smoothing(columns: usize) -> usize {
    ((SMOOTHING * columns) as f64 / PAPER_COLUMNS as f64).round() as usize
}

/// The classes with most pixels in these frames, largest first.
pub fn most_visible(truth: &dyn Truth, frames: &[usize]) -> Result<Vec<String>, EvaluateError> {
    let classes = classes(truth);
    let mut pixels: HashMap<&str, usize> = HashMap::new();
    for frame in frames {
        for class in truth.mask(*frame)?.ids.iter().filter_map(|id| classes.get(id)) {
            *pixels.entry(class).or_default() += 1;
        }
    }
    let mut order: Vec<(&str, usize)> = pixels.into_iter().collect();
    order.sort_by_key(|(class, pixels)| (Reverse(*pixels), *class));
    Ok(order.into_iter().take(LABELS).map(|(class, _)| class.to_owned()).collect())
}

fn classes(truth: &dyn Truth) -> HashMap<u16, &str> {
    truth.instances().iter().map(|thing| (thing.id, thing.class.as_str())).collect()
}

/// Which pixels show the class.
pub fn shows(mask: &Mask, truth: &dyn Truth, class: &str) -> Vec<bool> {
    let ids: BTreeSet<u16> = truth
        .instances()
        .iter()
        .filter(|thing| thing.class == class)
        .map(|thing| thing.id)
        .collect();
    mask.ids.iter().map(|id| ids.contains(id)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_is_scaled_with_the_frame() {
        assert_eq!([1200, 600, 640, 320].map(smoothing), [20, 10, 11, 5]);
    }
}
