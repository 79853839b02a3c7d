//! A part of a data set: every `stride`-th frame from `start` up to `end`, once or several times
//! forwards and backwards. Frames keep their numbers in one pass and are renumbered in several.

use super::error::DatasetError;
use super::part::Part;
use super::source::Dataset;
use std::num::NonZeroUsize;

/// Which frames to use, by position in the data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    /// The first position, from 0.
    pub start: usize,
    /// The position after the last; absent for the end.
    pub end: Option<usize>,
    /// Every `stride`-th frame is used.
    pub stride: NonZeroUsize,
    /// Number of passes: forwards, backwards, forwards ...
    pub passes: NonZeroUsize,
}

impl Default for FrameRange {
    /// All frames, once.
    fn default() -> Self {
        Self { start: 0, end: None, stride: NonZeroUsize::MIN, passes: NonZeroUsize::MIN }
    }
}

impl FrameRange {
    /// The part of `dataset`.
    ///
    /// # Errors
    /// [`DatasetError::Range`] if the range leaves no frames.
    pub fn of(self, dataset: Box<dyn Dataset>) -> Result<Box<dyn Dataset>, DatasetError> {
        if self == Self::default() {
            return Ok(dataset);
        }
        let len = dataset.len();
        let end = self.end.unwrap_or(len).min(len);
        let there: Vec<usize> = (self.start..end).step_by(self.stride.get()).collect();
        if there.is_empty() {
            let end = self.end.map_or("the end".into(), |end| end.to_string());
            return Err(DatasetError::Range { start: self.start, end, len });
        }
        let mut indices = there.clone();
        for pass in 1..self.passes.get() {
            // The frame at a turning point is used once.
            let others = there[1..].iter().copied();
            let back = there[..there.len() - 1].iter().rev().copied();
            if pass % 2 == 1 { indices.extend(back) } else { indices.extend(others) }
        }
        let (renumbered, skipped) = (self.passes.get() > 1, dataset.skipped().to_vec());
        Ok(Box::new(Part { dataset, indices, renumbered, skipped }))
    }
}
