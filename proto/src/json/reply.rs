//! The answer to a question of either kind.

use super::answer::Answer;
use super::segmentation::Segmentation;
use serde::Serialize;

/// The answer to a question with `text`, or to one with `texts`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(untagged)]
#[allow(clippy::large_enum_variant, reason = "one per request")]
pub enum Reply {
    /// Where the text is found.
    Answer(Answer),
    /// Which of the texts fits where.
    Segmentation(Segmentation),
}
