//! Errors of requests.

use super::fair_queue::Refused;
use super::limits::VOXEL_METRES;
use crate::pipeline::network::NetworkError;
use lexsplat_gpu::GpuError;

/// Why a request has no answer.
#[derive(Debug, thiserror::Error)]
pub enum QueryError {
    /// The view is of a frame that was not tracked.
    #[error("view.frame: expected a tracked frame's sequence, found {sequence}")]
    UnknownFrame {
        /// Requested sequence.
        sequence: u64,
    },
    /// A text is empty.
    #[error("{field}: expected a word, found none")]
    EmptyText {
        /// `text`, `texts` or `negatives`.
        field: &'static str,
    },
    /// A text is too long.
    #[error("{field}: expected at most {limit} bytes, found {found}")]
    TextTooLong {
        /// `text`, `texts` or `negatives`.
        field: &'static str,
        /// Permitted bytes.
        limit: usize,
        /// Bytes in the request.
        found: usize,
    },
    /// A text asks for something that cannot be decided.
    #[error("{field}: {reason}")]
    NotUnderstood {
        /// `text`.
        field: &'static str,
        /// What is not understood, and what to ask instead.
        reason: String,
    },
    /// A segmentation has too few or too many texts.
    #[error("texts: expected 1 to {limit}, found {found}")]
    WrongTextCount {
        /// Permitted number.
        limit: usize,
        /// Number in the request.
        found: usize,
    },
    /// There are too many negatives.
    #[error("negatives: expected at most {limit}, found {found}")]
    TooManyNegatives {
        /// Permitted number.
        limit: usize,
        /// Number in the request.
        found: usize,
    },
    /// A view's size is not permitted.
    #[error("{field}: expected 1x1 to {limit}x{limit} pixels, found {width}x{height}")]
    BadSize {
        /// `view.camera` or `size`.
        field: &'static str,
        /// The longest side, pixels.
        limit: u32,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A threshold is outside its range.
    #[error("threshold: expected 0 to 1, found {found}")]
    BadThreshold {
        /// Threshold in the request.
        found: f32,
    },
    /// The side of a voxel is outside its range.
    #[error(
        "voxel: expected {} to {} metres, found {found}",
        VOXEL_METRES.start(),
        VOXEL_METRES.end()
    )]
    BadVoxel {
        /// Side in the request, metres.
        found: f32,
    },
    /// The surfaces of the map do not fit into the memory for a mesh.
    #[error(
        "voxel: {voxel_metres} m needs more than {limit_mib} MiB for this map: ask for larger ones"
    )]
    MeshTooLarge {
        /// Side in the request, metres.
        voxel_metres: f32,
        /// Permitted memory, MiB.
        limit_mib: usize,
    },
    /// A picture has more pixels than the device can render.
    #[error(
        "width: {width}x{height} pixels are more than this server's device can render: ask for fewer"
    )]
    PictureTooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The client has as many questions waiting as it may.
    #[error("{waiting} questions of this client wait already: wait for answers before asking more")]
    TooMany {
        /// Number of its questions that wait.
        waiting: usize,
    },
    /// A network failed.
    #[error("a network failed")]
    Network(#[from] NetworkError),
    /// The device failed.
    #[error("the renderer failed")]
    Gpu(#[from] GpuError),
    /// The thread for a mesh could not be started.
    #[error("cannot start a thread")]
    Thread(#[source] std::io::Error),
    /// Computing the answer panicked.
    #[error("computing the answer failed: see the server's log")]
    Panicked,
    /// The query thread has ended.
    #[error("the server is stopping")]
    Stopped,
}

impl From<Refused> for QueryError {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Full(waiting) => Self::TooMany { waiting },
            Refused::Closed => Self::Stopped,
        }
    }
}

impl QueryError {
    /// The field of the request that is at fault; `None` if the request is not at fault.
    pub(crate) fn field(&self) -> Option<&'static str> {
        match self {
            Self::UnknownFrame { .. } => Some("view.frame"),
            Self::EmptyText { field }
            | Self::NotUnderstood { field, .. }
            | Self::TextTooLong { field, .. }
            | Self::BadSize { field, .. } => Some(field),
            Self::WrongTextCount { .. } => Some("texts"),
            Self::TooManyNegatives { .. } => Some("negatives"),
            Self::BadThreshold { .. } => Some("threshold"),
            Self::BadVoxel { .. } | Self::MeshTooLarge { .. } => Some("voxel_metres"),
            Self::PictureTooLarge { .. } => Some("width"),
            Self::TooMany { .. }
            | Self::Network(_)
            | Self::Gpu(_)
            | Self::Thread(_)
            | Self::Panicked
            | Self::Stopped => None,
        }
    }
}
