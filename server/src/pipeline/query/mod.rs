//! "Where is the coffee cup?" In: a [`MapSnapshot`] and a [`Query`] in plain words. Out: an
//! [`Answer`] with a heat map and boxes of one view, or points and objects in space; or, for a
//! [`RenderRequest`], a [`Picture`].
//!
//! One thread ([`QueryThread`]) owns the text networks and a renderer of its own. It only reads
//! snapshots: nothing here touches a live map.
//!
//! [`MapSnapshot`]: super::snapshot::MapSnapshot

mod answer;
mod boxes;
mod clusters;
mod picture;
mod presence;
mod regions;
mod relevancy;
mod request;
mod scene;
mod space;
mod text;
mod thread;
mod view;
mod viewpoint;

pub use answer::{Answer, Heatmap, Mask, Object, Peak, Picture, ScoredBox, ScoredPoint, Timing};
pub use request::{Channel, MAX_NEGATIVES, MAX_TEXT_BYTES, Outputs, Query, RenderRequest, View};
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
    /// Side of the mean filter over a heat map, pixels at the view's size.
    pub smoothing_pixels: u32,
    /// Relevancy above which something counts; `None`: the bundle's.
    pub threshold: Option<f32>,
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
}

impl Default for QueryConfig {
    fn default() -> Self {
        Self {
            queue: 8,
            smoothing_pixels: 20,
            threshold: None,
            code_columns: 160,
            cached_texts: 1024,
            feature_cache_mib: 512,
            cluster_metres: 0.08,
            cluster_points: 6,
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
    /// A network failed.
    #[error("a network failed")]
    Network(#[from] NetworkError),
    /// The device failed.
    #[error("the renderer failed")]
    Gpu(#[from] lexsplat_gpu::GpuError),
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
            Self::TooManyNegatives { .. } => Some("negatives"),
            Self::BadThreshold { .. } => Some("threshold"),
            Self::Network(_) | Self::Gpu(_) | Self::Stopped => None,
        }
    }
}

#[cfg(test)]
mod tests;
