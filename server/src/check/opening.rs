//! Opening messages of streams.

use super::camera;
use super::labels;
use super::limits::Limits;
use super::refusal::Refusal;
use crate::pipeline::frame::Intrinsics;
use lexsplat_proto::v1;
use std::sync::Arc;

/// The largest size of one unit of depth, metres.
const MAX_DEPTH_UNIT_METRES: f64 = 1.0;

/// A checked opening message; it holds for all frames of the stream.
#[derive(Clone, Debug)]
pub(crate) struct Opening {
    pub(crate) intrinsics: Intrinsics,
    /// Metres per unit of 16-bit depth; `None` if it was not given, then only depth in metres is
    /// accepted.
    pub(crate) depth_unit_metres: Option<f64>,
    /// Whether the server estimates the poses.
    pub(crate) estimates_poses: bool,
    /// Text of each label; empty if frames carry no labels.
    pub(crate) label_texts: Arc<[String]>,
}

/// Checks an opening message, except for the map's name, which the engine checks.
///
/// # Errors
/// [`Refusal`] names the field.
pub(crate) fn opening(open: &v1::OpenMap, limits: &Limits) -> Result<Opening, Refusal> {
    let estimates_poses = match v1::PoseSource::try_from(open.pose_source) {
        Ok(v1::PoseSource::Unspecified | v1::PoseSource::Given) => false,
        Ok(v1::PoseSource::Estimated) => true,
        Err(_) => {
            let reason = format!(
                "unknown source {}, expected POSE_SOURCE_GIVEN or POSE_SOURCE_ESTIMATED",
                open.pose_source
            );
            return Err(Refusal::new("pose_source", reason));
        }
    };
    let wire = open.intrinsics.as_ref().ok_or_else(|| {
        Refusal::new("intrinsics", "missing: expected width, height, fx, fy, cx and cy in pixels")
    })?;
    let intrinsics = camera::from_wire("intrinsics", wire, limits.max_pixels)?;
    let unit = open.depth_unit_metres;
    // This form of the condition also refuses NaN.
    if !(0.0..=MAX_DEPTH_UNIT_METRES).contains(&unit) {
        let reason = format!(
            "expected metres per unit, above 0 and at most 1 (0.001 for millimetres), found {unit}"
        );
        return Err(Refusal::new("depth_unit_metres", reason));
    }
    let depth_unit_metres = (unit > 0.0).then_some(unit);
    let label_texts = labels::texts(&open.label_texts)?;
    Ok(Opening { intrinsics, depth_unit_metres, estimates_poses, label_texts })
}
