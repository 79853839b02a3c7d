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
pub use mesh::{DEFAULT_VOXEL_METRES, Mesh, VOXEL_METRES, mesh};
pub use request::{
    Bounds, Channel, Contest, MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, Outputs, Place, Query,
    RenderRequest, View,
};
pub use thread::QueryThread;

use super::network::NetworkError;
use serde::{Deserialize, Serialize};

/// The longest side of a view that is answered or rendered, pixels.
pub const MAX_VIEW_SIDE: u32 = 4096;

/// How questions are answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QueryConfig {
    /// Questions that wait for the thread; when full the asker waits.
    pub queue: usize,
    /// Side of the mean filter over a heat map of [`SMOOTHED_COLUMNS`] columns, pixels; over others in
    /// proportion.
    pub smoothing_pixels: u32,
    /// Relevancy above which something counts; `None`: the bundle's.
    pub threshold: Option<f32>,
    /// Bias of the relevancy: how much nearer to its word a feature must be for 0.5, times the
    /// temperature; `None`: the bundle's, which suits features as its networks see them.
    pub bias: Option<f32>,
    /// Columns at which a view's codes are rendered and decoded (fewer if the view has fewer).
    pub code_columns: u32,
    /// Texts whose embeddings are kept.
    pub cached_texts: usize,
    /// Memory for the decoded features of one map, MiB; a larger map is decoded at every question.
    pub feature_cache_mib: usize,
    /// Objects: two Gaussians with less than this between them are one object, metres.
    pub cluster_metres: f32,
    /// Objects: Gaussians of the smallest one; as many must reach a score for it to speak for presence.
    pub cluster_points: usize,
    /// Objects: how far above the threshold, as a share of how far the best one is (in logits).
    pub object_score: f32,
    /// Objects: least Gaussians, as a share of the largest one's.
    pub object_size: f32,
}

/// Columns of the pictures that the paper's filter of 20 pixels is for.
const SMOOTHED_COLUMNS: f32 = 1200.0;

impl QueryConfig {
    /// Side of the mean filter over a view of so many columns, pixels, at least 1: the asked one, else
    /// the configured one in proportion.
    fn smoothing(&self, asked: Option<u32>, columns: u32) -> usize {
        let usual = self.smoothing_pixels as f32 * columns as f32 / SMOOTHED_COLUMNS;
        asked.unwrap_or(usual.round() as u32).max(1) as usize
    }
}

impl Default for QueryConfig {
    fn default() -> Self {
        Self {
            queue: 8,
            smoothing_pixels: 20,
            threshold: None,
            bias: None,
            code_columns: 200,
            cached_texts: 1024,
            feature_cache_mib: 512,
            cluster_metres: 0.15,
            cluster_points: 10,
            object_score: 0.5,
            object_size: 0.02,
        }
    }
}

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
