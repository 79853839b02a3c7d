//! What a map answers: relevancies, boxes, points and objects, in the map's world and in metres.

use nalgebra::{Point3, UnitQuaternion, Vector3};

/// The answer to a [`super::Query`].
#[derive(Clone, Debug)]
pub struct Answer {
    /// The map's revision that was asked.
    pub revision: u64,
    /// Whether what was asked for is there.
    pub present: bool,
    /// How sure it is that it is there, 0..1; `present` is one half or more.
    pub confidence: f32,
    /// How much of what was asked about has language in it, 0..1: "never seen" is not "seen,
    /// absent".
    pub coverage: f32,
    /// The relevancy above which something counted.
    pub threshold: f32,
    /// The relevancy of every pixel.
    pub heatmap: Option<Heatmap>,
    /// Pixels above the threshold.
    pub mask: Option<Mask>,
    /// One per connected region, best first.
    pub boxes: Option<Vec<ScoredBox>>,
    /// The most relevant pixel (view queries).
    pub peak: Option<Peak>,
    /// The surface of the objects' Gaussians, 2 cm apart.
    pub points: Option<Vec<ScoredPoint>>,
    /// Clusters of relevant Gaussians, best first.
    pub objects: Option<Vec<Object>>,
    /// Where the time went.
    pub timing: Timing,
}

/// Relevancy in 0..1, `[height * width]`, row-major.
#[derive(Clone, Debug)]
pub struct Heatmap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The relevancies.
    pub values: Vec<f32>,
}

/// A binary mask as COCO run lengths: column-major, starting with zeros.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Run lengths; they add up to `height * width`.
    pub counts: Vec<u32>,
}

/// A box in pixels, `x`, `y` its top-left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoredBox {
    /// Left column.
    pub x: f32,
    /// Top row.
    pub y: f32,
    /// Columns.
    pub width: f32,
    /// Rows.
    pub height: f32,
    /// The region's highest relevancy.
    pub score: f32,
}

/// The most relevant pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Column.
    pub x: f32,
    /// Row.
    pub y: f32,
    /// Its relevancy.
    pub score: f32,
}

/// A relevant Gaussian's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoredPoint {
    /// Metres, in the map's world.
    pub position: Point3<f32>,
    /// Its relevancy.
    pub score: f32,
}

/// A cluster of relevant Gaussians.
#[derive(Clone, Debug)]
pub struct Object {
    /// Its relevancy, 0..1.
    pub score: f32,
    /// Centre of the oriented box, metres.
    pub center: Point3<f32>,
    /// Sides of the oriented box, metres.
    pub size: Vector3<f32>,
    /// The oriented box's axes: `world_from_box`.
    pub rotation: UnitQuaternion<f32>,
    /// Axis-aligned box, least corner.
    pub aabb_min: Point3<f32>,
    /// Axis-aligned box, greatest corner.
    pub aabb_max: Point3<f32>,
    /// Gaussians in it.
    pub points: usize,
    /// From the asked point to the oriented box, metres; 0 inside.
    pub distance: Option<f32>,
}

/// The answer to a [`super::Contest`]. Label 0 is "none of them", label `k` the `k`-th text.
#[derive(Clone, Debug)]
pub struct Segmentation {
    /// The map's revision that was asked.
    pub revision: u64,
    /// How much of what was asked about has language in it, 0..1.
    pub coverage: f32,
    /// The relevancy that the best text had to exceed.
    pub threshold: f32,
    /// Of each text, the share of the pixels, or of the Gaussians, that have its label.
    pub shares: Vec<f32>,
    /// The label of every pixel (view queries).
    pub image: Option<LabelImage>,
    /// The label of every Gaussian with language (3D queries).
    pub points: Option<Vec<LabelledPoint>>,
    /// Where the time went.
    pub timing: Timing,
}

/// Labels, `[height * width]`, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LabelImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The labels.
    pub labels: Vec<u8>,
}

/// A Gaussian's centre with the best text's label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelledPoint {
    /// Metres, in the map's world.
    pub position: Point3<f32>,
    /// 0: none.
    pub label: u8,
    /// The best text's relevancy, whether it counted or not.
    pub score: f32,
}

/// Milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    /// Text tower (0 when cached).
    pub text: f32,
    /// Rendering codes.
    pub render: f32,
    /// 15 -> 32 -> D.
    pub decode: f32,
    /// Relevancy, smoothing, regions, clusters.
    pub score: f32,
    /// All of it, waiting in the queue included.
    pub total: f32,
}

/// A rendered picture.
#[derive(Clone, Debug)]
pub enum Picture {
    /// `[height * width * 3]`, 8 bit.
    Rgb {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The pixels.
        data: Vec<u8>,
    },
    /// `[height * width]`, metres; 0 where nothing is.
    Depth {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The depths.
        metres: Vec<f32>,
    },
}
