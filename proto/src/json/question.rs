//! Questions to a map.

use super::camera::View;
use serde::{Deserialize, Serialize};

/// A question in plain words: `text`, or `texts` that are compared with each other. Without `view`
/// the question is about the whole map in 3D.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Question {
    /// What to look for: "chair", "Where are the chairs?", "red chair next to the window". Colors, sizes and
    /// places of things are decided one by one; `understood` in the answer says how the text was understood.
    /// What is in quotes is a name, word by word. A text with a negation that is not understood ("not a
    /// chair") is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(example = "coffee cup"))]
    pub text: Option<String>,
    /// Instead of `text`: 1 to 32 texts. Each pixel, or each Gaussian, is labelled with the text
    /// that fits it best.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(example = json!(["chair", "table", "floor"])))]
    pub texts: Option<Vec<String>>,
    /// Texts that the text is compared against; absent or empty: those of the model bundle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub negatives: Option<Vec<String>>,
    /// Answer for this view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view: Option<View>,
    /// Only with `text`: any of heatmap, uncertainty, mask, boxes, points, objects; absent or
    /// empty: all that fit the question.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(value_type = Option<Vec<OutputName>>))]
    pub outputs: Option<Vec<String>>,
    /// Relevancy above which something counts as found, 0 to 1; absent: the default of the model
    /// bundle, or 0.5 with `texts`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f32>,
    /// Side of the mean filter over the heat map, pixels; 0 turns it off.
    #[serde(rename = "smoothing_pixels", skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<u32>,
    /// The largest number of objects in the answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_objects: Option<u32>,
    /// 3D only: objects are sorted by their distance to this point and have `distance_metres`.
    #[serde(rename = "near_metres", skip_serializing_if = "Option::is_none")]
    pub near: Option<[f32; 3]>,
    /// 3D only: keep the points inside this box, and the objects with their centre inside it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within: Option<Bounds>,
}

impl Question {
    /// A 3D question with one text.
    pub fn in_space(text: &str) -> Self {
        Self { text: Some(text.into()), ..Self::default() }
    }

    /// A question with one text about the view of a tracked frame.
    pub fn in_frame(text: &str, sequence: u64) -> Self {
        Self { view: Some(View::of_frame(sequence)), ..Self::in_space(text) }
    }
}

/// An axis-aligned box, metres in the map's world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// The corner with the smallest coordinates.
    #[serde(rename = "min_metres")]
    pub min: [f32; 3],
    /// The corner with the largest coordinates.
    #[serde(rename = "max_metres")]
    pub max: [f32; 3],
}

/// The parts that an answer may have, as the OpenAPI document lists them.
#[cfg(feature = "schema")]
#[derive(utoipa::ToSchema)]
#[schema(rename_all = "snake_case")]
#[expect(dead_code, reason = "only its names are used")]
enum OutputName {
    Heatmap,
    Uncertainty,
    Mask,
    Boxes,
    Points,
    Objects,
}
