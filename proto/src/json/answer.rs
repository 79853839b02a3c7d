//! Answers to questions with one text.

use serde::{Deserialize, Serialize};

/// Where a text is found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Answer {
    /// Id under which the heat map and the points can be fetched.
    pub query_id: String,
    /// As it was sent.
    pub text: String,
    /// How it was understood.
    #[serde(default)]
    pub understood: Understood,
    pub map: String,
    /// Revision of the map that the answer was computed from.
    pub revision: u64,
    /// The newest frame that the map had then; absent before the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub through: Option<u64>,
    /// Whether the map had done its work on all frames that it had received. If not, the answer may change.
    #[serde(default)]
    pub settled: bool,
    /// Whether it had also been refined.
    #[serde(default)]
    pub converged: bool,
    /// Whether the map shows what was asked for.
    pub present: bool,
    /// Why nothing was found, where an attribute or a relation decided that, or could not be decided.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(example = "no window was found"))]
    pub reason: Option<String>,
    /// How likely it is there, 0 to 1; `present` says whether that is one half or more.
    pub confidence: f32,
    /// Share of the view or map that has language, 0 to 1. If it is low, absent only means not
    /// seen.
    pub coverage: f32,
    /// Relevancy above which something counted as found.
    pub threshold: f32,
    /// View queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heatmap: Option<HeatmapLink>,
    /// The probability that a pixel is in the mask and should not be, or the other way round; view queries
    /// only. 0 where nothing was seen (see `coverage`), and where a color, a size or a place excludes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<HeatmapLink>,
    /// Pixels above the threshold; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<Rle>,
    /// One box for each connected region of the mask, best first; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boxes: Option<Vec<PixelBox>>,
    /// The most relevant pixel; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak: Option<Peak>,
    /// 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PointsLink>,
    /// Best first, or nearest first if the question has `near_metres`; 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(value_type = Option<Vec<FoundObject>>))]
    pub objects: Option<Vec<Object>>,
    pub timing_ms: Timing,
}

/// How a text was understood: the parts that are decided one by one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Understood {
    /// The kind of thing.
    #[cfg_attr(feature = "schema", schema(example = "chair"))]
    pub object: String,
    /// What it looks like: "red", "not big".
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub attributes: Vec<String>,
    /// Where it is, without the other thing: "next to", "not on".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relation: Option<String>,
    /// The other thing, as a text that asks for it; two for "between".
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<String>,
}

/// Where to fetch a value for every pixel, 0 to 1: its relevancy, or its uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct HeatmapLink {
    pub width: u32,
    pub height: u32,
    /// The smallest value in it.
    pub min: f32,
    /// The largest value in it.
    pub max: f32,
    /// Its address, relative to that of the question: `queries/ID/PART`.
    pub url: String,
}

/// Where to fetch the points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct PointsLink {
    /// Number of points.
    pub count: usize,
    /// Its address, relative to that of the question: `queries/ID/PART`.
    pub url: String,
}

/// A mask as COCO run lengths: column-major, the first run is of zeros.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Rle {
    /// Height, width.
    pub size: [u32; 2],
    pub counts: Vec<u32>,
}

/// A box in pixels; (x, y) is its top-left corner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct PixelBox {
    pub x: f32,
    pub y: f32,
    pub width: f32,
    pub height: f32,
    /// Relevancy of its best pixel.
    pub score: f32,
}

/// The most relevant pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Peak {
    pub x: f32,
    pub y: f32,
    pub score: f32,
}

/// An object in 3D with an oriented and an axis-aligned box, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema), schema(as = FoundObject))]
pub struct Object {
    /// Its relevancy, 0 to 1.
    pub score: f32,
    /// Confidence that it is what was asked for, 0 to 1.
    #[serde(default)]
    pub confidence: f32,
    /// Centre of the oriented box.
    #[serde(rename = "center_metres")]
    pub center: [f32; 3],
    /// Sides of the oriented box.
    #[serde(rename = "size_metres")]
    pub size: [f32; 3],
    /// `world_from_box` of the oriented box: quaternion (w, x, y, z).
    pub rotation: [f32; 4],
    #[serde(rename = "aabb_min_metres")]
    pub aabb_min: [f32; 3],
    #[serde(rename = "aabb_max_metres")]
    pub aabb_max: [f32; 3],
    /// Number of points.
    pub points: usize,
    /// From `near_metres` to the oriented box; 0 inside.
    #[serde(rename = "distance_metres", skip_serializing_if = "Option::is_none")]
    pub distance: Option<f32>,
}

/// The name of [`Object`] in the OpenAPI document, where that word means any object.
#[cfg(feature = "schema")]
type FoundObject = Object;

/// Time spent on an answer, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Timing {
    /// Encoding the texts.
    pub text: f32,
    /// Rendering language codes.
    pub render: f32,
    /// Decoding the codes into embeddings.
    pub decode: f32,
    /// Comparing embeddings with the texts.
    pub score: f32,
    pub total: f32,
}
