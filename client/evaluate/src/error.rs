//! Errors of an evaluation; each message is one line.

use crate::lpips::LpipsError;
use lexsplat_client::dataset::DatasetError;
use lexsplat_client::http::HttpError;
use lexsplat_client::stream::ClientError;

/// An evaluation that could not be finished.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The data set could not be streamed.
    #[error(transparent)]
    Stream(#[from] ClientError),
    /// A request to the server failed.
    #[error(transparent)]
    Http(#[from] HttpError),
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The map exists already.
    #[error("map {map:?} is there already with {frames} frames: name a new one with --map")]
    MapInUse {
        /// Name of the map.
        map: String,
        /// Frames in it.
        frames: u64,
    },
    /// No frame was tracked, so nothing can be measured.
    #[error("none of {sent} frames is in the map: {reason}")]
    NothingTracked {
        /// Frames sent.
        sent: u64,
        /// The first refusal, if there is one.
        reason: String,
    },
    /// No frame that a file of labels describes was tracked.
    #[error(
        "labels: none of the {labelled} frames of the file is in the map, so nothing can be asked"
    )]
    NothingLabelled {
        /// Frames in the file.
        labelled: usize,
    },
    /// The server rendered an image of the wrong size.
    #[error("frame {sequence}: expected a picture of {expected:?}, found {found:?}")]
    Size {
        /// Number of the frame.
        sequence: u64,
        /// Columns and rows of the frame.
        expected: (u32, u32),
        /// Columns and rows of the rendered image.
        found: (u32, u32),
    },
    /// LPIPS failed.
    #[error(transparent)]
    Lpips(#[from] LpipsError),
    /// An image cannot be decoded.
    #[error("frame {sequence}: a picture cannot be decoded")]
    Picture {
        /// Number of the frame.
        sequence: u64,
        /// Error of the decoder.
        source: image::ImageError,
    },
    /// The server's trajectory is not TUM text, or an answer lacks its heat map or points.
    #[error("malformed answer of the server: {reason}")]
    Answer {
        /// What is wrong with it.
        reason: String,
    },
}
