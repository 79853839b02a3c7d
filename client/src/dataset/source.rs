//! The trait that every data set implements.

use super::error::DatasetError;
use super::frame::{Cameras, Intrinsics, Moment, RgbdFrame};
use super::truth::Truth;

/// A sequence of RGB-D frames of one camera.
pub trait Dataset: Send + Sync {
    /// A short name, such as `room7`; the map is called so if no other name is given.
    fn name(&self) -> &str;

    /// Number of frames.
    fn len(&self) -> usize;

    /// Whether there are no frames. Opening a folder without frames is an error.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The pinhole camera that the frames are of, or that they are to be seen with: that of
    /// [`Dataset::clean_frame`].
    fn intrinsics(&self) -> Intrinsics;

    /// The cameras as they are, with distortion, and depth apart from color.
    fn cameras(&self) -> Cameras {
        self.intrinsics().into()
    }

    /// Metres per unit of depth.
    fn depth_unit_metres(&self) -> f64;

    /// The number of frame `index` (below [`Dataset::len`]), without reading it.
    fn sequence(&self, index: usize) -> u64;

    /// Reads or renders frame `index` (below [`Dataset::len`]).
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError>;

    /// When and where frame `index` was taken. Data sets that render frames know it without rendering.
    ///
    /// # Errors
    /// As [`Dataset::frame`].
    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let RgbdFrame { timestamp_nanos, world_from_camera, .. } = self.frame(index)?;
        Ok(Moment { timestamp_nanos, world_from_camera })
    }

    /// Frame `index` without a simulated sensor: what a perfect one would have sent. Maps are scored
    /// against it. The same as [`Dataset::frame`] for a data set whose frames were not changed.
    ///
    /// # Errors
    /// As [`Dataset::frame`].
    fn clean_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.frame(index)
    }

    /// What was done to the frames to simulate a sensor, in words for a report; absent if nothing.
    fn simulated(&self) -> Option<String> {
        None
    }

    /// Why frame `index` has no pose, in words; `None` if it has one, or if nothing more is known.
    fn no_pose(&self, _index: usize) -> Option<&str> {
        None
    }

    /// Reasons for frames left out when the data set was opened, one line per frame.
    fn skipped(&self) -> &[String] {
        &[]
    }

    /// What was assumed when the data set was opened, such as a camera that no file describes; in words.
    fn notes(&self) -> &[String] {
        &[]
    }

    /// Ground truth about the objects, if the data set has any.
    fn truth(&self) -> Option<&dyn Truth> {
        None
    }
}
