//! Some frames of a data set, in any order.

use super::error::DatasetError;
use super::frame::{Moment, RgbdFrame, counted_nanos};
use super::layer::Layer;
use super::source::Dataset;
use super::truth::{Instance, Mask, Truth};

pub(super) struct Part {
    pub dataset: Box<dyn Dataset>,
    /// Places of its frames in the data set.
    pub indices: Vec<usize>,
    /// Frames are numbered by their position in this part.
    pub renumbered: bool,
    /// See [`Dataset::skipped`].
    pub skipped: Vec<String>,
}

impl Part {
    fn numbered(&self, mut frame: RgbdFrame, index: usize) -> RgbdFrame {
        if self.renumbered {
            frame.sequence = index as u64;
            frame.timestamp_nanos = counted_nanos(frame.sequence);
        }
        frame
    }
}

impl Layer for Part {
    fn below(&self) -> &dyn Dataset {
        &*self.dataset
    }

    fn count(&self) -> usize {
        self.indices.len()
    }

    fn sequence(&self, index: usize) -> u64 {
        if self.renumbered { index as u64 } else { self.dataset.sequence(self.indices[index]) }
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        Ok(self.numbered(self.dataset.frame(self.indices[index])?, index))
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let moment = self.dataset.moment(self.indices[index])?;
        let nanos = counted_nanos(index as u64);
        let timestamp_nanos = if self.renumbered { nanos } else { moment.timestamp_nanos };
        Ok(Moment { timestamp_nanos, ..moment })
    }

    fn clean_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        Ok(self.numbered(self.dataset.clean_frame(self.indices[index])?, index))
    }

    fn no_pose(&self, index: usize) -> Option<&str> {
        self.dataset.no_pose(self.indices[index])
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn truth(&self) -> Option<&dyn Truth> {
        self.dataset.truth().map(|_| self as &dyn Truth)
    }
}

impl Truth for Part {
    fn instances(&self) -> &[Instance] {
        self.dataset.truth().map_or(&[], Truth::instances)
    }

    fn mask(&self, index: usize) -> Result<Mask, DatasetError> {
        let truth = self.dataset.truth().expect("a part is offered as truth only if the whole is");
        truth.mask(self.indices[index])
    }
}
