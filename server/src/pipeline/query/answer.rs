//! Answers of a map, in the map's world and in metres.

use nalgebra::{Point3, UnitQuaternion, Vector3};

/// The answer to a [`Query`](super::Query).
#[derive(Clone, Debug)]
pub struct Answer {
    /// Revision of the map that was asked.
    pub revision: u64,
    /// How the text was understood.
    pub understood: Understood,
    /// Whether the map contains what was asked for: `confidence` is at least one half.
    pub present: bool,
    /// Why it does not, where an attribute or a relation decided that, or could not be decided.
    pub reason: Option<String>,
    /// Confidence that the map contains what was asked for, 0..1.
    pub confidence: f32,
    /// Share of the view's pixels or of the map's Gaussians that have language, 0..1. It tells
    /// "not yet seen" from "seen and absent".
    pub coverage: f32,
    /// Relevancy above which a pixel or a Gaussian counted.
    pub threshold: f32,
    /// The relevancy of each pixel (2D).
    pub heatmap: Option<Heatmap>,
    /// The probability that a pixel is in the mask and should not be, or the other way round (2D).
    pub uncertainty: Option<Heatmap>,
    /// Pixels above the threshold (2D).
    pub mask: Option<Mask>,
    /// Boxes of the mask's connected components, best first (2D).
    pub boxes: Option<Vec<ScoredBox>>,
    /// The most relevant pixel (2D).
    pub peak: Option<Peak>,
    /// Points on the surface of the objects' Gaussians, 2 cm apart (3D).
    pub points: Option<Vec<ScoredPoint>>,
    /// Clusters of relevant Gaussians, best first (3D).
    pub objects: Option<Vec<Object>>,
    /// Duration of each step.
    pub timing: Timing,
}

/// How a text was understood: the parts that are decided one by one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Understood {
    /// The kind of thing.
    pub object: String,
    /// What it looks like: "red", "not big".
    pub attributes: Vec<String>,
    /// Where it is, without the other thing: "next to", "not on".
    pub relation: Option<String>,
    /// The other thing, as a text that asks for it; two for "between".
    pub others: Vec<String>,
}

/// A value in 0..1 for each pixel, `[height * width]`, row-major.
#[derive(Clone, Debug)]
pub struct Heatmap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Relevancies or uncertainties.
    pub values: Vec<f32>,
}

/// A binary mask in COCO's run-length encoding: column-major, starting with zeros.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Run lengths; they add up to `height * width`.
    pub counts: Vec<u32>,
}

/// A box in pixels; `x`, `y` is its top-left corner.
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
    /// The component's highest relevancy.
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

/// A point with a relevancy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoredPoint {
    /// Metres, in the map's world.
    pub position: Point3<f32>,
    /// The relevancy of its Gaussian.
    pub score: f32,
}

/// A cluster of relevant Gaussians.
#[derive(Clone, Debug)]
pub struct Object {
    /// Its relevancy, 0..1.
    pub score: f32,
    /// Confidence that it is what was asked for, 0..1.
    pub confidence: f32,
    /// Centre of the oriented box, metres.
    pub center: Point3<f32>,
    /// Sides of the oriented box, metres.
    pub size: Vector3<f32>,
    /// Orientation of the oriented box: `world_from_box`.
    pub rotation: UnitQuaternion<f32>,
    /// Least corner of the axis-aligned box, metres.
    pub aabb_min: Point3<f32>,
    /// Greatest corner of the axis-aligned box, metres.
    pub aabb_max: Point3<f32>,
    /// Number of Gaussians.
    pub points: usize,
    /// From the query's `near` point to the oriented box, metres; 0 inside.
    pub distance: Option<f32>,
}

/// The answer to a [`SegmentationRequest`](super::SegmentationRequest). Label 0 is "none of the
/// texts", label `k` the `k`-th text.
#[derive(Clone, Debug)]
pub struct Segmentation {
    /// Revision of the map that was asked.
    pub revision: u64,
    /// Share of the view's pixels or of the map's Gaussians that have language, 0..1.
    pub coverage: f32,
    /// Relevancy that the best text had to exceed.
    pub threshold: f32,
    /// For each text, the share of the pixels or of the Gaussians with its label.
    pub shares: Vec<f32>,
    /// The label of each pixel (2D).
    pub image: Option<LabelImage>,
    /// The label of each Gaussian with language (3D).
    pub points: Option<Vec<LabelledPoint>>,
    /// Duration of each step.
    pub timing: Timing,
}

/// Labels, `[height * width]`, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LabelImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Labels.
    pub labels: Vec<u8>,
}

/// The centre of a Gaussian with its label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelledPoint {
    /// Metres, in the map's world.
    pub position: Point3<f32>,
    /// 0: none of the texts.
    pub label: u8,
    /// The best text's relevancy, also if it is below the threshold.
    pub score: f32,
}

/// Durations, milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    /// Text tower; 0 when the embeddings are cached.
    pub text: f32,
    /// Rendering of codes.
    pub render: f32,
    /// Decoding of codes to features.
    pub decode: f32,
    /// Relevancy, smoothing, components and clusters.
    pub score: f32,
    /// From the arrival of the request to the answer, including the wait in the queue.
    pub total: f32,
}

/// A rendered image.
#[derive(Clone, Debug)]
pub enum RenderedImage {
    /// `[height * width * 3]`, 8 bit.
    Rgb {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Pixels.
        data: Vec<u8>,
    },
    /// `[height * width]`, metres; 0 where there is no depth.
    Depth {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Depths.
        metres: Vec<f32>,
    },
    /// `[height * width]`: how far the codes of keyframes spread around the map's; 0 without language.
    Spread {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Spreads.
        values: Vec<f32>,
    },
}
