//! Data sets on top of other ones: a part, a simulated sensor, a record of what was read.

use super::error::DatasetError;
use super::frame::{Cameras, Intrinsics, Moment, RgbdFrame};
use super::source::Dataset;
use super::truth::Truth;

/// A data set that changes some of another one. What it does not say is as in the one below. Every layer is a
/// [`Dataset`]; the methods are described there.
pub trait Layer: Send + Sync {
    /// The data set that is changed.
    fn below(&self) -> &dyn Dataset;

    /// [`Dataset::frame`].
    ///
    /// # Errors
    /// As [`Dataset::frame`].
    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.below().frame(index)
    }

    /// [`Dataset::len`].
    fn count(&self) -> usize {
        self.below().len()
    }

    /// [`Dataset::intrinsics`].
    fn intrinsics(&self) -> Intrinsics {
        self.below().intrinsics()
    }

    /// [`Dataset::cameras`].
    fn cameras(&self) -> Cameras {
        self.below().cameras()
    }

    /// [`Dataset::sequence`].
    fn sequence(&self, index: usize) -> u64 {
        self.below().sequence(index)
    }

    /// [`Dataset::moment`].
    ///
    /// # Errors
    /// As [`Dataset::frame`].
    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        self.below().moment(index)
    }

    /// [`Dataset::clean_frame`].
    ///
    /// # Errors
    /// As [`Dataset::frame`].
    fn clean_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.below().clean_frame(index)
    }

    /// [`Dataset::no_pose`].
    fn no_pose(&self, index: usize) -> Option<&str> {
        self.below().no_pose(index)
    }

    /// [`Dataset::skipped`].
    fn skipped(&self) -> &[String] {
        self.below().skipped()
    }

    /// [`Dataset::simulated`].
    fn simulated(&self) -> Option<String> {
        self.below().simulated()
    }

    /// [`Dataset::truth`].
    fn truth(&self) -> Option<&dyn Truth> {
        self.below().truth()
    }
}

impl<T: Layer> Dataset for T {
    fn name(&self) -> &str {
        self.below().name()
    }

    fn len(&self) -> usize {
        self.count()
    }

    fn intrinsics(&self) -> Intrinsics {
        Layer::intrinsics(self)
    }

    fn cameras(&self) -> Cameras {
        Layer::cameras(self)
    }

    fn depth_unit_metres(&self) -> f64 {
        self.below().depth_unit_metres()
    }

    fn sequence(&self, index: usize) -> u64 {
        Layer::sequence(self, index)
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        Layer::frame(self, index)
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        Layer::moment(self, index)
    }

    fn clean_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        Layer::clean_frame(self, index)
    }

    fn simulated(&self) -> Option<String> {
        Layer::simulated(self)
    }

    fn no_pose(&self, index: usize) -> Option<&str> {
        Layer::no_pose(self, index)
    }

    fn skipped(&self) -> &[String] {
        Layer::skipped(self)
    }

    fn notes(&self) -> &[String] {
        self.below().notes()
    }

    fn truth(&self) -> Option<&dyn Truth> {
        Layer::truth(self)
    }
}
