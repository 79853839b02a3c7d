//! What is asked for, and where it is seen: the classes of the data set's masks (protocol of paper
//! §5), or the labels of a file. Also the constants of that protocol.

mod file;
mod label;
mod masks;

pub use file::{LabelFile, LabelFileError};
pub use label::{COUNTED_EVERY, LEAST_PIXELS, TEST_FRAMES};
pub(crate) use label::{Label, Labels, Place, Sight};
pub use masks::{ABSENT_NOUNS, LABELS};

use crate::error::EvaluateError;
use lexsplat_client::dataset::Dataset;

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

/// Where the labels come from.
#[derive(Clone, Debug)]
pub enum LabelSource {
    /// The masks of the data set, if it has any.
    Masks,
    /// A file.
    File(LabelFile),
}

impl<'a> Labels<'a> {
    /// The labels of a source; `None` if it has none. `tracked` are the positions of the frames in the
    /// map, `unseen` those of them that the map was not made of.
    pub fn of(
        source: &'a LabelSource,
        dataset: &'a dyn Dataset,
        tracked: &[usize],
        unseen: &[usize],
    ) -> Result<Option<Self>, EvaluateError> {
        Ok(match source {
            LabelSource::Masks => match dataset.truth() {
                Some(truth) => Some(masks::labels(truth, tracked, unseen)?),
                None => None,
            },
            LabelSource::File(file) => Some(file.labels(dataset, tracked)?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_is_scaled_with_the_frame() {
        assert_eq!([1200, 600, 640, 320].map(smoothing), [20, 10, 11, 5]);
    }
}
