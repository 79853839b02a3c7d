//! A data set whose frames are scored against those of another one: a recording through real lenses against
//! the same walk seen by an ideal camera.

use super::error::DatasetError;
use super::frame::{Intrinsics, RgbdFrame};
use super::layer::Layer;
use super::source::Dataset;
use super::truth::{Instance, Mask, Truth};
use std::collections::BTreeMap;

/// The frames of one data set, and the same frames of another one to compare with.
pub struct Against {
    dataset: Box<dyn Dataset>,
    clean: Box<dyn Dataset>,
    /// Places of the clean frames by their numbers.
    places: BTreeMap<u64, usize>,
}

impl Against {
    /// Frames belong together by their numbers.
    ///
    /// # Errors
    /// [`DatasetError::Content`] if a frame of `dataset` is not in `clean`.
    pub fn new(dataset: Box<dyn Dataset>, clean: Box<dyn Dataset>) -> Result<Self, DatasetError> {
        let places: BTreeMap<u64, usize> =
            (0..clean.len()).map(|index| (clean.sequence(index), index)).collect();
        let missing = (0..dataset.len())
            .map(|index| dataset.sequence(index))
            .find(|sequence| !places.contains_key(sequence));
        match missing {
            Some(sequence) => Err(DatasetError::content(
                clean.name().as_ref(),
                format!("expected frame {sequence} of {} to score it against", dataset.name()),
            )),
            None => Ok(Self { dataset, clean, places }),
        }
    }

    fn place(&self, index: usize) -> usize {
        self.places[&self.dataset.sequence(index)]
    }
}

impl Layer for Against {
    fn below(&self) -> &dyn Dataset {
        &*self.dataset
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.dataset.frame(index)
    }

    fn intrinsics(&self) -> Intrinsics {
        self.clean.intrinsics()
    }

    fn clean_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.clean.frame(self.place(index))
    }

    fn simulated(&self) -> Option<String> {
        let before = self.dataset.simulated().map(|words| words + ", ").unwrap_or_default();
        Some(format!("{before}scored against {}", self.clean.name()))
    }

    fn truth(&self) -> Option<&dyn Truth> {
        self.clean.truth().map(|_| self as &dyn Truth)
    }
}

impl Truth for Against {
    fn instances(&self) -> &[Instance] {
        self.clean.truth().map_or(&[], Truth::instances)
    }

    fn mask(&self, index: usize) -> Result<Mask, DatasetError> {
        let truth = self.clean.truth().expect("offered as truth only if the clean one has it");
        truth.mask(self.place(index))
    }
}
