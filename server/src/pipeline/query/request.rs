//! What can be asked of a map: a [`Query`] in words, or a [`RenderRequest`] for a picture.
//!
//! Made by the edges (`http`, `ingest`) from checked input.

use super::super::frame::Intrinsics;
use nalgebra::{Isometry3, Point3};

/// The longest text that is taken, in bytes.
pub const MAX_TEXT_BYTES: usize = 1024;
/// The most negatives in one query.
pub const MAX_NEGATIVES: usize = 32;
/// The longest side of a view that is answered or rendered, pixels.
pub const MAX_VIEW_SIDE: u32 = 4096;

/// A question in plain words.
#[derive(Clone, Debug)]
pub struct Query {
    /// What is looked for; not empty, at most [`MAX_TEXT_BYTES`].
    pub text: String,
    /// What it is not; empty: the bundle's canonical negatives.
    pub negatives: Vec<String>,
    /// Answer for this view; `None` is a 3D query.
    pub view: Option<View>,
    /// What to put into the answer.
    pub outputs: Outputs,
    /// Relevancy above which something counts; `None`: the bundle's.
    pub threshold: Option<f32>,
    /// Side of the mean filter over the heat map, pixels; 0 or 1: none; `None`: the configured one.
    pub smoothing_pixels: Option<u32>,
    /// The most objects in the answer.
    pub max_objects: usize,
    /// Where in space to look (3D).
    pub place: Place,
}

/// The most texts that are compared with each other.
pub const MAX_TEXTS: usize = 32;

/// Several texts compared with each other: which of them is each pixel, or each Gaussian?
#[derive(Clone, Debug)]
pub struct Contest {
    /// What may be there, 2 to [`MAX_TEXTS`], all different.
    pub texts: Vec<String>,
    /// What it is not; empty: the bundle's canonical negatives.
    pub negatives: Vec<String>,
    /// Answer for this view; `None` is a 3D query.
    pub view: Option<View>,
    /// Relevancy that the best text must exceed, or there is no label; `None`: 0.5, nearer to the
    /// text than to every negative. 0: every place with language gets a label.
    pub threshold: Option<f32>,
    /// Side of the mean filter over relevancies, pixels; 0 or 1: none; `None`: the configured one.
    pub smoothing_pixels: Option<u32>,
}

/// Where in space objects and points may be, metres in the map's world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Objects nearest to this point come first, and say how far they are.
    pub near: Option<Point3<f32>>,
    /// Only points, and objects whose centres are, between these corners.
    pub within: Option<Bounds>,
}

/// An axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The least corner.
    pub min: Point3<f32>,
    /// The greatest corner; no coordinate is less than the least corner's.
    pub max: Point3<f32>,
}

impl Bounds {
    /// Whether a point is in the box or on its border.
    pub fn contains(&self, point: &Point3<f32>) -> bool {
        (0..3).all(|axis| (self.min[axis]..=self.max[axis]).contains(&point[axis]))
    }
}

/// A place to look from.
#[derive(Clone, Debug)]
pub enum View {
    /// A tracked frame, by sequence.
    Frame(u64),
    /// Any camera.
    Camera {
        /// Its intrinsics.
        intrinsics: Intrinsics,
        /// Its pose.
        world_from_camera: Isometry3<f64>,
    },
}

/// What an answer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// The relevancy of every pixel (2D).
    pub heatmap: bool,
    /// Pixels above the threshold (2D).
    pub mask: bool,
    /// One box per connected region of the mask (2D).
    pub boxes: bool,
    /// Centres with their scores of the relevant Gaussians that belong to some object, the smallest and
    /// those beyond `max_objects` too (3D).
    pub points: bool,
    /// Relevant Gaussians clustered into objects (3D).
    pub objects: bool,
}

impl Outputs {
    /// All that fit a view query.
    pub const VIEW: Self =
        Self { heatmap: true, mask: true, boxes: true, points: false, objects: false };
    /// All that fit a 3D query.
    pub const SPACE: Self =
        Self { heatmap: false, mask: false, boxes: false, points: true, objects: true };
    /// Nothing.
    pub const NONE: Self =
        Self { heatmap: false, mask: false, boxes: false, points: false, objects: false };
}

/// What a rendered picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// The color head.
    Color,
    /// Depth in metres, from the color head.
    Depth,
    /// Language codes, three principal directions as colors.
    Language,
    /// Opacity of the color head.
    Opacity,
}

/// A picture of the map.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// From where.
    pub view: View,
    /// Of what.
    pub channel: Channel,
    /// Another size than the view's camera has, `(width, height)` in pixels.
    pub size: Option<(u32, u32)>,
}
