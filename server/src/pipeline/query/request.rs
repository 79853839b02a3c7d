//! Requests to a map: a [`Query`], a [`SegmentationRequest`] or a [`RenderRequest`].
//!
//! The edges (`http`, `ingest`) make them from checked input.

use super::error::QueryError;
use crate::pipeline::frame::Intrinsics;
use nalgebra::{Isometry3, Point3};

/// A question in plain words: where is it?
#[derive(Clone, Debug)]
pub struct Query {
    /// Text of what is looked for: not empty, at most 1024 bytes long.
    pub text: String,
    /// Negative texts; empty: the bundle's canonical negatives.
    pub negatives: Vec<String>,
    /// View for a 2D query; `None`: a 3D query.
    pub view: Option<View>,
    /// Parts of the answer.
    pub outputs: Outputs,
    /// Relevancy above which a pixel or a Gaussian counts, 0..1; `None`: the configured one.
    pub threshold: Option<f32>,
    /// Side of the mean filter over the heat map, pixels. 0 or 1: no filter. `None`: the configured
    /// one.
    pub smoothing_pixels: Option<u32>,
    /// The most objects in the answer (3D).
    pub max_objects: usize,
    /// Restriction and order of objects and points (3D).
    pub filter: SpatialFilter,
}

/// An open-vocabulary segmentation: which of several texts does each pixel or Gaussian match best?
#[derive(Clone, Debug)]
pub struct SegmentationRequest {
    /// Texts of the labels: 1 to 32, all different.
    pub texts: Vec<String>,
    /// Negative texts; empty: the bundle's canonical negatives.
    pub negatives: Vec<String>,
    /// View for a 2D segmentation; `None`: all Gaussians.
    pub view: Option<View>,
    /// Relevancy that the best text must exceed to be the label, 0..1. `None`: 0.5, nearer to the
    /// text than to all negatives. 0: each place with language gets a label.
    pub threshold: Option<f32>,
    /// Side of the mean filter over relevancy maps, pixels. 0 or 1: no filter. `None`: the
    /// configured one.
    pub smoothing_pixels: Option<u32>,
}

/// Restriction and order of objects and points, metres in the map's world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialFilter {
    /// Objects are sorted by their distance to this point.
    pub near: Option<Point3<f32>>,
    /// Only points, and objects with centres, within this box.
    pub within: Option<Bounds>,
}

/// An axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The least corner.
    pub min: Point3<f32>,
    /// The greatest corner; no coordinate is less than that of `min`.
    pub max: Point3<f32>,
}

impl Bounds {
    /// Whether a point is in the box or on its border.
    pub(crate) fn contains(&self, point: &Point3<f32>) -> bool {
        (0..3).all(|axis| (self.min[axis]..=self.max[axis]).contains(&point[axis]))
    }
}

/// A viewpoint.
#[derive(Clone, Debug)]
pub enum View {
    /// The pose of a tracked frame, by its sequence, with the camera of the stream.
    Frame(u64),
    /// An arbitrary camera.
    Camera {
        /// Its intrinsics.
        intrinsics: Intrinsics,
        /// Its pose.
        world_from_camera: Isometry3<f64>,
    },
}

/// Parts of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// The relevancy of each pixel (2D).
    pub heatmap: bool,
    /// The probability of each pixel of the mask to be wrong (2D).
    pub uncertainty: bool,
    /// Pixels above the threshold (2D).
    pub mask: bool,
    /// One box for each connected component of the mask (2D).
    pub boxes: bool,
    /// Scored points on the Gaussians of all objects, including those beyond `max_objects` (3D).
    pub points: bool,
    /// Clusters of relevant Gaussians (3D).
    pub objects: bool,
}

impl Outputs {
    /// No parts.
    pub const NONE: Self = Self {
        heatmap: false,
        uncertainty: false,
        mask: false,
        boxes: false,
        points: false,
        objects: false,
    };
    /// All parts of a 2D answer.
    pub const VIEW: Self =
        Self { heatmap: true, uncertainty: true, mask: true, boxes: true, ..Self::NONE };
    /// All parts of a 3D answer.
    pub const SPACE: Self = Self { points: true, objects: true, ..Self::NONE };
}

/// Content of a rendered image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Color of the color head.
    Color,
    /// Depth of the color head, metres.
    Depth,
    /// Language codes: their three principal components as colors.
    Language,
    /// Opacity of the color head.
    Opacity,
    /// How far the codes of keyframes spread around the map's, as colors from 0 to 1.
    Spread,
}

/// An image of the map.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// Viewpoint.
    pub view: View,
    /// Content.
    pub channel: Channel,
    /// `(width, height)` in pixels; `None`: the size of the view's camera.
    pub size: Option<(u32, u32)>,
}

/// The requested threshold, or else `default`.
pub(super) fn checked_threshold(requested: Option<f32>, default: f32) -> Result<f32, QueryError> {
    let threshold = requested.unwrap_or(default);
    match (0.0..=1.0).contains(&threshold) {
        true => Ok(threshold),
        false => Err(QueryError::BadThreshold { found: threshold }),
    }
}
