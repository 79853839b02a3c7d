//! What can be wrong with a data set: every message names the file (and line) and what was expected.

use std::path::{Path, PathBuf};

/// Why a data set cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The file system refused.
    #[error("cannot read {path}", path = path.display())]
    File {
        /// What was being read.
        path: PathBuf,
        /// The reason given.
        source: std::io::Error,
    },
    /// A file does not hold what it should.
    #[error("{path}{line}: {reason}", path = path.display(), line = line.map_or(String::new(), |l| format!(":{l}")))]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// From 1.
        line: Option<usize>,
        /// What was expected and what was found.
        reason: String,
    },
    /// A picture cannot be decoded.
    #[error("{path}: expected a picture that can be decoded", path = path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// The reason given.
        source: image::ImageError,
    },
    /// A picture cannot be encoded.
    #[error("frame {sequence} cannot be encoded")]
    Encode {
        /// The frame.
        sequence: u64,
        /// The reason given.
        source: image::ImageError,
    },
    /// The range leaves nothing.
    #[error("no frames from {start} to {end}: the data set has {len}")]
    Range {
        /// First index.
        start: usize,
        /// Index after the last, or "the end".
        end: String,
        /// Frames there are.
        len: usize,
    },
}

impl DatasetError {
    /// A whole file or folder is not as it should be.
    pub(crate) fn content(path: &Path, reason: impl Into<String>) -> Self {
        Self::Content { path: path.to_path_buf(), line: None, reason: reason.into() }
    }

    /// A line (from 1) is not as it should be.
    pub(super) fn at_line(path: &Path, line: usize, reason: impl Into<String>) -> Self {
        Self::Content { path: path.to_path_buf(), line: Some(line), reason: reason.into() }
    }
}
