//! Errors.

use super::map::LoadProgress;
use serde::{Deserialize, Serialize};

/// An error as an RFC 9457 problem document (`application/problem+json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Problem {
    /// A URI for the kind of problem.
    #[serde(rename = "type", default)]
    #[cfg_attr(feature = "schema", schema(required))]
    pub kind: String,
    /// The kind of problem in words.
    pub title: String,
    /// The HTTP status.
    #[cfg_attr(feature = "schema", schema(example = 400))]
    pub status: u16,
    /// What was expected and what was found.
    #[cfg_attr(feature = "schema", schema(example = "threshold: expected 0 to 1, found 3"))]
    pub detail: String,
    /// The request field with the error.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "schema", schema(example = "threshold"))]
    pub field: Option<String>,
    /// With status 503: how far the map is loaded that the request needs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub progress: Option<LoadProgress>,
}
