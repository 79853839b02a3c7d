//! Answers to questions about a map: "Where is the coffee cup?"
//!
//! In: a [`MapSnapshot`] and a request. Out: for a [`Query`] an [`Answer`], with heat map and boxes
//! of one view, or points and objects in space; for a [`SegmentationRequest`] a [`Segmentation`];
//! for a [`RenderRequest`] a [`RenderedImage`]; and a [`Mesh`].
//!
//! One thread ([`QueryThread`]) owns the text networks and a renderer of its own. It only reads
//! snapshots, never a live map.
//!
//! [`MapSnapshot`]: super::snapshot::MapSnapshot

mod answer;
mod camera;
mod choice;
mod config;
mod disjoint_sets;
mod error;
mod fair_queue;
mod feature_decoder;
mod labels;
mod limits;
mod mesh;
mod question;
mod relevancy;
mod render;
mod request;
mod search;
mod space;
mod stopwatch;
mod text;
mod thread;
mod turns;
mod view;
mod worker;

pub use answer::{
    Answer, Heatmap, LabelImage, LabelledPoint, Mask, Object, Peak, RenderedImage, ScoredBox,
    ScoredPoint, Segmentation, Timing, Understood,
};
pub use config::QueryConfig;
pub use error::QueryError;
pub use fair_queue::Client;
pub(crate) use limits::{
    DEFAULT_VOXEL_METRES, MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, MAX_VIEW_SIDE,
};
pub use mesh::Mesh;
pub(crate) use mesh::mesh;
pub use request::{
    Bounds, Channel, Outputs, Query, RenderRequest, SegmentationRequest, SpatialFilter, View,
};
pub use thread::QueryThread;
pub(crate) use turns::Turns;

#[cfg(test)]
mod tests;
