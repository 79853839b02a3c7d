//! Labels of a data set with masks: the classes with most pixels. The test frames are evenly spaced
//! over the tracked frames that the map was not made of.

use super::label::{COUNTED_EVERY, Label, Labels, Sight, Sights, TEST_FRAMES};
use crate::error::EvaluateError;
use crate::statistics::spread;
use lexsplat_client::dataset::Truth;
use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};

/// Number of classes that are asked for.
pub const LABELS: usize = 10;
/// Number of absent nouns that are asked for.
pub const ABSENT_NOUNS: usize = 30;
/// Household nouns; those that the scene has are left out.
#[rustfmt::skip]
const ABSENT: [&str; 40] = [
    "washing machine", "vacuum cleaner", "ironing board", "aquarium", "bird cage", "candle",
    "toaster", "hair dryer", "sewing machine", "christmas tree", "rocking horse", "fireplace",
    "bathtub", "toilet", "piano", "guitar", "umbrella", "scissors", "banana", "pizza", "bicycle",
    "tennis racket", "skateboard", "microwave", "broom", "bucket", "ladder", "backpack", "suitcase",
    "teddy bear", "hammock", "dishwasher", "toothbrush", "shower", "watering can", "typewriter",
    "wheelchair", "violin", "baby crib", "chessboard",
];

/// The classes with most pixels in every fifth of the tracked frames, and what frames show of them.
pub(super) fn labels<'a>(
    truth: &'a dyn Truth,
    tracked: &[usize],
    unseen: &[usize],
) -> Result<Labels<'a>, EvaluateError> {
    let counted: Vec<usize> = tracked.iter().copied().step_by(COUNTED_EVERY).collect();
    let classes = most_visible(truth, &counted)?;
    let is_there = |noun: &str| truth.instances().iter().any(|thing| thing.class == noun);
    let absent = ABSENT.into_iter().filter(|noun| !is_there(noun)).take(ABSENT_NOUNS);
    let label =
        |name: &String| Label { name: name.clone(), query: name.clone(), synonyms: Vec::new() };
    Ok(Labels {
        labels: classes.iter().map(label).collect(),
        frames: spread(unseen, TEST_FRAMES),
        absent: absent.map(str::to_owned).collect(),
        sights: Box::new(Masks { truth, classes }),
        masks: Some(truth),
        file: None,
    })
}

/// The classes with most pixels in these frames, largest first.
fn most_visible(truth: &dyn Truth, frames: &[usize]) -> Result<Vec<String>, EvaluateError> {
    let classes: HashMap<u16, &str> =
        truth.instances().iter().map(|thing| (thing.id, thing.class.as_str())).collect();
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

struct Masks<'a> {
    truth: &'a dyn Truth,
    classes: Vec<String>,
}

impl Sights for Masks<'_> {
    fn of(&self, frame: usize) -> Result<Vec<Sight>, EvaluateError> {
        let mask = self.truth.mask(frame)?;
        let sight = |class: &String| {
            let things = self.truth.instances().iter().filter(|thing| thing.class == *class);
            let ids: BTreeSet<u16> = things.map(|thing| thing.id).collect();
            let shows = mask.ids.iter().map(|id| ids.contains(id)).collect();
            Sight::of_mask(shows, mask.width as usize)
        };
        Ok(self.classes.iter().map(sight).collect())
    }
}
