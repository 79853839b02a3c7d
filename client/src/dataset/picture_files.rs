//! Pictures that are files of their own, as in every layout of folders.

use super::error::DatasetError;
use super::files::{self, Size};
use super::frame::{Color, Depth};
use super::prepare::Preparation;
use super::recording::Pictures;
use std::path::PathBuf;

/// Frames whose headers are read to learn the size of all: one damaged picture decides nothing.
const SAMPLES: usize = 9;

/// The files of a frame.
#[derive(Clone, Debug)]
pub(super) struct FrameFiles {
    pub color: PathBuf,
    pub depth: PathBuf,
    /// The picture of depth's confidence.
    pub confidence: Option<PathBuf>,
}

/// The files of all frames, and what is done to them.
#[derive(Debug)]
pub(super) struct PictureFiles {
    pub frames: Vec<FrameFiles>,
    pub preparation: Preparation,
}

impl FrameFiles {
    /// Depth without a confidence.
    pub fn new(color: PathBuf, depth: PathBuf) -> Self {
        Self { color, depth, confidence: None }
    }

    fn size(&self) -> Result<Size, DatasetError> {
        let size = files::size(&self.color)?;
        files::check_size(&self.depth, size)?;
        Ok(size)
    }
}

impl PictureFiles {
    /// Files that are passed on as they are.
    pub fn plain(frames: Vec<FrameFiles>) -> Self {
        Self { frames, preparation: Preparation::default() }
    }

    /// The size of color and depth that most of a few frames have.
    ///
    /// # Errors
    /// What is wrong with the first frame, if no frame looked at has color and depth of one size.
    pub fn size(&self) -> Result<Size, DatasetError> {
        self.usual(FrameFiles::size)
    }

    /// The sizes that color and depth of most of a few frames have, once they are turned.
    ///
    /// # Errors
    /// What is wrong with the first frame, if color or depth of no frame looked at can be read.
    pub fn sizes(&self) -> Result<[Size; 2], DatasetError> {
        Ok([
            self.usual(|files| self.preparation.color_size(&files.color))?,
            self.usual(|files| self.preparation.depth_size(&files.depth))?,
        ])
    }

    fn usual(
        &self,
        size: impl Fn(&FrameFiles) -> Result<Size, DatasetError>,
    ) -> Result<Size, DatasetError> {
        let mut found: Vec<(Size, usize)> = Vec::new();
        let mut wrong = None;
        for files in self.frames.iter().step_by(self.frames.len().div_ceil(SAMPLES).max(1)) {
            match size(files) {
                Ok(size) => match found.iter_mut().find(|(other, _)| *other == size) {
                    Some((_, times)) => *times += 1,
                    None => found.push((size, 1)),
                },
                Err(error) => wrong = wrong.or(Some(error)),
            }
        }
        // Of sizes that are equally frequent, the first.
        match (found.iter().rev().max_by_key(|(_, times)| *times), wrong) {
            (Some((size, _)), _) => Ok(*size),
            (None, Some(error)) => Err(error),
            (None, None) => unreachable!("there is at least one frame"),
        }
    }
}

impl Pictures for PictureFiles {
    fn pictures(&self, index: usize, sequence: u64) -> Result<(Color, Depth), DatasetError> {
        let FrameFiles { color, depth, confidence } = &self.frames[index];
        let color = self.preparation.color(color, sequence)?;
        Ok((color, self.preparation.depth(depth, confidence.as_ref(), sequence)?))
    }
}
