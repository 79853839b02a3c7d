//! Opening messages of streams.

use super::cameras;
use super::direction::direction;
use super::labels;
use super::limits::Limits;
use super::refusal::Refusal;
use crate::pipeline::registration::Registration;
use lexsplat_proto::v1;
use nalgebra::UnitVector3;
use std::sync::Arc;

/// The largest size of one unit of depth, metres.
const MAX_DEPTH_UNIT_METRES: f64 = 1.0;

/// What cameras and files write where 16 bits do not hold the depth, or where there is none.
const SATURATED: u16 = u16::MAX;
/// Most values that may mean no measurement.
const MOST_NO_DEPTH: usize = 16;

/// A checked opening message; it holds for all frames of the stream.
#[derive(Clone, Debug)]
pub(crate) struct Opening {
    /// Brings frames to one pinhole camera.
    pub(crate) registration: Arc<Registration>,
    /// Metres per unit of 16-bit depth; `None` if it was not given, then only depth in metres is
    /// accepted.
    pub(crate) depth_unit_metres: Option<f64>,
    /// Depths that count as measurements.
    pub(crate) depths: Depths,
    /// Whether the server estimates the poses.
    pub(crate) estimates_poses: bool,
    /// Text of each label; empty if frames carry no labels.
    pub(crate) label_texts: Arc<[String]>,
    /// The direction up in the coordinates of the poses or hints.
    pub(crate) up: Option<UnitVector3<f64>>,
}

/// Which depths count as measurements.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Depths {
    /// Nearest and farthest, metres.
    pub(crate) range_metres: [f32; 2],
    /// Values of the 16-bit formats that mean no measurement, beside 0.
    pub(crate) none: Arc<[u16]>,
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
    let registration = Arc::new(cameras::registration(open, limits)?);
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
    let depths = depths(open, limits)?;
    let up = direction("up", open.up.as_ref())?;
    Ok(Opening { registration, depth_unit_metres, depths, estimates_poses, label_texts, up })
}

fn depths(open: &v1::OpenMap, limits: &Limits) -> Result<Depths, Refusal> {
    let widest = [limits.min_depth_metres, limits.max_depth_metres];
    let wanted = [open.min_depth_metres, open.max_depth_metres];
    let fields = ["min_depth_metres", "max_depth_metres"];
    let mut range_metres = widest;
    for (at, (field, metres)) in fields.into_iter().zip(wanted).enumerate() {
        if !(metres.is_finite() && metres >= 0.0) {
            let reason = format!("expected metres, 0 for the server's limit, found {metres}");
            return Err(Refusal::new(field, reason));
        }
        if metres > 0.0 {
            range_metres[at] = (metres as f32).clamp(widest[0], widest[1]);
        }
    }
    if range_metres[0] >= range_metres[1] {
        let [near, far] = widest;
        let reason = format!(
            "expected min_depth_metres below it, and both within the server's {near} to {far} metres, found {} to {}",
            wanted[0], wanted[1]
        );
        return Err(Refusal::new("max_depth_metres", reason));
    }
    if open.no_depth.len() > MOST_NO_DEPTH {
        let reason = format!("expected at most {MOST_NO_DEPTH}, found {}", open.no_depth.len());
        return Err(Refusal::new("no_depth", reason));
    }
    let value = |value: &u32| {
        u16::try_from(*value)
            .map_err(|_| Refusal::new("no_depth", format!("expected 0 to 65535, found {value}")))
    };
    let none: Vec<u16> = open.no_depth.iter().map(value).collect::<Result<_, _>>()?;
    let none = if none.is_empty() { vec![SATURATED] } else { none };
    Ok(Depths { range_metres, none: none.into() })
}
