//! "Where is the coffee cup?" In: a [`MapSnapshot`] and a [`Query`] in plain words. Out: an
//! [`Answer`] with a heat map and boxes of one view, or points and objects in space; for a [`Contest`] of
//! several texts a [`Segmentation`]; for a [`RenderRequest`] a [`Picture`]; and a [`Mesh`].
//!
//! One thread ([`QueryThread`]) owns the text networks and a renderer of its own. It only reads
//! snapshots: nothing here touches a live map.
//!
//! [`MapSnapshot`]: super::snapshot::MapSnapshot

mod answer;
mod boxes;
mod clusters;
mod config;
mod cosines;
mod mesh;
mod neighbours;
mod picture;
mod place;
mod presence;
mod regions;
mod relevancy;
mod request;
mod rivals;
mod scene;
mod segment;
mod space;
mod surface;
mod text;
mod thread;
mod view;
mod viewpoint;

pub use answer::{
    Answer, Heatmap, LabelImage, LabelledPoint, Mask, Object, Peak, Picture, ScoredBox,
    ScoredPoint, Segmentation, Timing,
};
pub use config::QueryConfig;
pub use mesh::{DEFAULT_VOXEL_METRES, Mesh, VOXEL_METRES, mesh};
pub use request::{
    Bounds, Channel, Contest, MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, MAX_VIEW_SIDE, Outputs,
    Place, Query, RenderRequest, View,
};
pub use thread::QueryThread;

use super::network::NetworkError;

/// Why a question has no answer.
#[derive(Debug, thiserror::Error)]
pub enum QueryError {
    /// The view is of a frame that was not tracked.
    #[error("view.frame: expected a tracked frame's sequence, found {sequence}")]
    UnknownFrame {
        /// What was asked for.
        sequence: u64,
    },
    /// A text without a word in it.
    #[error("{field}: expected a word, found nothing but white space")]
    EmptyText {
        /// `text` or `negatives`.
        field: &'static str,
    },
    /// A text that is too long.
    #[error("{field}: expected at most {limit} bytes, found {found}")]
    TextTooLong {
        /// `text` or `negatives`.
        field: &'static str,
        /// The limit.
        limit: usize,
        /// What was given.
        found: usize,
    },
    /// Too few texts to compare, or too many.
    #[error("texts: expected 2 to {limit}, found {found}")]
    WrongTextCount {
        /// The most.
        limit: usize,
        /// What was given.
        found: usize,
    },
    /// More negatives than are compared with.
    #[error("negatives: expected at most {limit}, found {found}")]
    TooManyNegatives {
        /// The limit.
        limit: usize,
        /// What was given.
        found: usize,
    },
    /// A view that cannot be rendered.
    #[error("{field}: expected 1x1 to {limit}x{limit} pixels, found {width}x{height}")]
    BadSize {
        /// `view.camera` or `size`.
        field: &'static str,
        /// The longest side.
        limit: u32,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A threshold that nothing or everything passes.
    #[error("threshold: expected 0 to 1, found {found}")]
    BadThreshold {
        /// What was given.
        found: f32,
    },
    /// A voxel that no mesh is made of.
    #[error("voxel: expected {} to {} metres, found {found}", VOXEL_METRES.start(), VOXEL_METRES.end())]
    BadVoxel {
        /// What was given.
        found: f32,
    },
    /// More surface than memory.
    #[error(
        "voxel: {voxel_metres} m needs more than {limit_mib} MiB for this map: ask for larger ones"
    )]
    MeshTooLarge {
        /// What was given.
        voxel_metres: f32,
        /// What there is.
        limit_mib: usize,
    },
    /// A network failed.
    #[error("a network failed")]
    Network(#[from] NetworkError),
    /// The device failed.
    #[error("the renderer failed")]
    Gpu(#[from] lexsplat_gpu::GpuError),
    /// No thread for the mesh.
    #[error("cannot start a thread")]
    Thread(#[source] std::io::Error),
    /// The query thread has ended.
    #[error("the server is stopping")]
    Stopped,
}

impl QueryError {
    /// The request's field at fault; `None` where it is not the request's fault.
    pub fn field(&self) -> Option<&'static str> {
        match self {
            Self::UnknownFrame { .. } => Some("view.frame"),
            Self::EmptyText { field }
            | Self::TextTooLong { field, .. }
            | Self::BadSize { field, .. } => Some(field),
            Self::WrongTextCount { .. } => Some("texts"),
            Self::TooManyNegatives { .. } => Some("negatives"),
            Self::BadThreshold { .. } => Some("threshold"),
            Self::BadVoxel { .. } | Self::MeshTooLarge { .. } => Some("voxel"),
            Self::Network(_) | Self::Gpu(_) | Self::Thread(_) | Self::Stopped => None,
        }
    }
}

#[cfg(test)]
mod tests;
