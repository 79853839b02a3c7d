//! Errors of data sets; each message names the file (and line) and what was expected.

use std::path::{Path, PathBuf};

/// A data set that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// A file cannot be read.
    #[error("cannot read {path}", path = path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file has unexpected content.
    #[error("{path}{line}: {reason}", path = path.display(), line = line.map_or(String::new(), |l| format!(":{l}")))]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// Line number from 1.
        line: Option<usize>,
        /// What was expected and what was found.
        reason: String,
    },
    /// An image cannot be decoded.
    #[error("{path}: expected a picture that can be decoded", path = path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// Error of the decoder or encoder.
        source: image::ImageError,
    },
    /// An image cannot be encoded.
    #[error("frame {sequence} cannot be encoded")]
    Encode {
        /// Number of the frame.
        sequence: u64,
        /// Error of the decoder or encoder.
        source: image::ImageError,
    },
    /// A frame's image cannot be decoded.
    #[error("frame {sequence} cannot be decoded")]
    Decode {
        /// Number of the frame.
        sequence: u64,
        /// Error of the decoder.
        source: image::ImageError,
    },
    /// A frame's images do not fit the camera.
    #[error("frame {sequence}: expected {expected} pixels as the camera has, found {found}")]
    Pixels {
        /// Number of the frame.
        sequence: u64,
        /// Columns times rows of the camera.
        expected: usize,
        /// Pixels of the image.
        found: usize,
    },
    /// No frame has a pose, although poses were to be given.
    #[error(
        "{name}: no frame has a pose ({reason}); the server can estimate them (--poses estimate)"
    )]
    NoPoses {
        /// Name of the data set.
        name: String,
        /// Why the first frame has none.
        reason: String,
    },
    /// The range leaves no frames.
    #[error("no frames from {start} to {end}: the data set has {len}")]
    Range {
        /// First position.
        start: usize,
        /// Position after the last, or "the end".
        end: String,
        /// Number of frames in the data set.
        len: usize,
    },
}

impl DatasetError {
    /// The error with its cause, in one line.
    pub fn whole(&self) -> String {
        use std::error::Error as _;
        self.source().map_or_else(|| self.to_string(), |source| format!("{self}: {source}"))
    }

    /// An error of a whole file or folder.
    pub(crate) fn content(path: &Path, reason: impl Into<String>) -> Self {
        Self::Content { path: path.to_path_buf(), line: None, reason: reason.into() }
    }

    /// No frame was found; the first reason for one that was left out explains why.
    pub(super) fn no_frames(path: &Path, expected: &str, skipped: &[String]) -> Self {
        let first = skipped.first().map_or(String::new(), |reason| format!(" ({reason})"));
        Self::content(path, format!("{expected}{first}"))
    }

    /// An error of a line (from 1).
    pub(super) fn at_line(path: &Path, line: usize, reason: impl Into<String>) -> Self {
        Self::Content { path: path.to_path_buf(), line: Some(line), reason: reason.into() }
    }
}
