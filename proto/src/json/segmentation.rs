//! Answers to questions with several texts.

use super::answer::{PointsLink, Timing};
use serde::{Deserialize, Serialize};

/// Which of several texts fits where. Label 0 is none of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Segmentation {
    /// Id under which the labels can be fetched.
    pub query_id: String,
    pub texts: Vec<String>,
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
    /// Share of the view or map that has language, 0 to 1.
    pub coverage: f32,
    /// Relevancy that the best text had to exceed to become the label.
    pub threshold: f32,
    /// One entry for each text, in the order of `texts`.
    pub legend: Vec<LegendEntry>,
    /// Labels of the pixels; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelsLink>,
    /// Labels of the Gaussians; 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PointsLink>,
    pub timing_ms: Timing,
}

/// What a label means.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct LegendEntry {
    /// The value of its pixels.
    pub label: usize,
    pub text: String,
    /// Its color in the PNG and the PLY.
    #[cfg_attr(feature = "schema", schema(example = "#e6194b"))]
    pub color: String,
    /// Share of all pixels, or Gaussians, with this label, 0 to 1.
    pub share: f32,
}

/// Where to fetch the labels of the pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct LabelsLink {
    pub width: u32,
    pub height: u32,
    /// Its address, relative to that of the question: `queries/ID/PART`.
    pub url: String,
}
