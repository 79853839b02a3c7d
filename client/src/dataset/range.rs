//! A part of a data set: every `stride`-th frame from `start` up to `end`, once or several times
//! forwards and backwards. Frames keep their numbers in one pass and are renumbered in several.

use super::error::DatasetError;
use super::frame::{Moment, RgbdFrame, counted_nanos};
use super::layer::Layer;
use super::source::Dataset;
use super::truth::{Instance, Mask, Truth};
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
        Ok(Box::new(Part { dataset, indices, renumbered: self.passes.get() > 1 }))
    }
}

struct Part {
    dataset: Box<dyn Dataset>,
    indices: Vec<usize>,
    /// Frames are numbered by their position in this part.
    renumbered: bool,
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
