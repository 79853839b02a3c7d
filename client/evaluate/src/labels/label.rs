//! Labels, and what frames show of them.

use crate::error::EvaluateError;
use crate::score::{Bounds, boxes};
use lexsplat_client::dataset::Truth;

/// The pixels of classes are counted in every fifth frame.
pub const COUNTED_EVERY: usize = 5;
/// Number of frames that are asked about, as in the paper.
pub const TEST_FRAMES: usize = 21;
/// Fewest pixels with which a label counts in a frame.
pub const LEAST_PIXELS: usize = 60;

/// A label and the texts that ask for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Label {
    /// Its name.
    pub name: String,
    /// The text that asks for it.
    pub query: String,
    /// Other texts that ask for it.
    pub synonyms: Vec<String>,
}

/// What a frame shows of a label.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Sight {
    /// The frame shows it here.
    Shown(Place),
    /// The frame does not show it.
    Hidden,
    /// It is not known whether the frame shows it, or it has too few pixels to count.
    Unclear,
}

/// Where a frame shows a label.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Place {
    /// Boxes around it; at least one.
    pub boxes: Vec<Bounds>,
    /// Its pixels `[height * width]`, row by row, if they are known.
    pub mask: Option<Vec<bool>>,
}

impl Sight {
    /// By the pixels `[height * width]` of a label.
    pub(super) fn of_mask(mask: Vec<bool>, width: usize) -> Self {
        match mask.iter().filter(|is_shown| **is_shown).count() {
            0 => Self::Hidden,
            pixels if pixels < LEAST_PIXELS => Self::Unclear,
            _ => Self::Shown(Place { boxes: boxes(&mask, width), mask: Some(mask) }),
        }
    }
}

/// Tells what frames show.
pub(crate) trait Sights {
    /// What a frame (position in the data set) shows of each label, in the order of the labels.
    fn of(&self, frame: usize) -> Result<Vec<Sight>, EvaluateError>;
}

/// What is asked for.
pub(crate) struct Labels<'a> {
    /// All labels that some frame shows.
    pub labels: Vec<Label>,
    /// The frames to ask about, by their positions in the data set.
    pub frames: Vec<usize>,
    /// Nouns of which the scene has nothing.
    pub absent: Vec<String>,
    /// What these frames show.
    pub sights: Box<dyn Sights + 'a>,
    /// The masks, if the labels are of masks: then they are scored in space, too.
    pub masks: Option<&'a dyn Truth>,
    /// Name of the file that they are from; absent: the data set's masks.
    pub file: Option<String>,
}

impl Labels<'_> {
    /// The texts that ask for the labels.
    pub fn queries(&self) -> Vec<String> {
        self.labels.iter().map(|label| label.query.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_with_a_few_pixels_is_neither_shown_nor_hidden() {
        let mask = |pixels: usize| (0..200).map(|at| at < pixels).collect::<Vec<_>>();
        assert_eq!(Sight::of_mask(mask(0), 20), Sight::Hidden);
        assert_eq!(Sight::of_mask(mask(LEAST_PIXELS - 1), 20), Sight::Unclear);
        let bounds = Bounds { columns: [0, 19], rows: [0, 2] };
        let place = Place { boxes: vec![bounds], mask: Some(mask(LEAST_PIXELS)) };
        assert_eq!(Sight::of_mask(mask(LEAST_PIXELS), 20), Sight::Shown(place));
    }
}
