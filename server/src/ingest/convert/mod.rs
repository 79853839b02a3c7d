//! Wire -> checked [`Frame`]: every check of what a robot sends is here or in a file beside.
//!
//! In: wire messages and [`Limits`]. Out: pipeline types that need no further check, or a
//! [`Refusal`] that names the field. Decoding is slow: call [`frame`] off the async threads.
//! `camera` and `question` are shared with the HTTP edge, so that both refuse alike.

pub(crate) mod camera;
mod color;
mod depth;
mod labels;
pub(crate) mod question;

use crate::ingest::config::IngestConfig;
use crate::pipeline::frame::{Frame, Intrinsics, PoseHint};
use lexsplat_proto::v1;
use nalgebra::{Isometry3, Matrix6};
use std::sync::Arc;

/// Numbers of a pose's covariance: 6x6.
const COVARIANCE_NUMBERS: usize = 36;
/// Metres per unit of depth above this are no depth image's.
const MAX_DEPTH_UNIT_METRES: f64 = 1.0;

/// What does not pass, and why.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct Refusal {
    /// The field at fault, as a path in the message.
    pub field: String,
    /// What was expected and what was found.
    pub reason: String,
}

impl Refusal {
    /// A refusal of `field`.
    pub fn new(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { field: field.into(), reason: reason.into() }
    }
}

/// How much is taken.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Pixels of an image.
    pub max_pixels: u64,
    /// Depth below this is no measurement, metres.
    pub min_depth_metres: f32,
    /// Depth above this is no measurement, metres.
    pub max_depth_metres: f32,
}

impl From<&IngestConfig> for Limits {
    fn from(config: &IngestConfig) -> Self {
        Self {
            max_pixels: config.max_pixels,
            min_depth_metres: config.min_depth_metres,
            max_depth_metres: config.max_depth_metres,
        }
    }
}

/// What a checked opening message says of the frames behind it.
#[derive(Clone, Debug)]
pub struct Opening {
    /// The camera of all frames.
    pub intrinsics: Intrinsics,
    /// Metres per unit of 16-bit depth; `None`: not given, so that only metres can come.
    pub depth_unit_metres: Option<f64>,
    /// Whether the server is to track the camera.
    pub estimates_poses: bool,
    /// What labels stand for; empty: frames carry none.
    pub label_texts: Arc<[String]>,
}

/// Checks the opening message (not the map's name: the engine does).
///
/// # Errors
/// [`Refusal`] names the field.
pub fn opening(open: &v1::OpenMap, limits: &Limits) -> Result<Opening, Refusal> {
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
    let intrinsics = wire_intrinsics("intrinsics", wire, limits.max_pixels)?;
    let unit = open.depth_unit_metres;
    // Phrased so that a NaN is refused.
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

/// Checks a frame and decodes its images.
///
/// `newest` is the sequence of the frame before, if there was one.
///
/// # Errors
/// [`Refusal`] names the field.
pub fn frame(
    wire: &v1::Frame,
    opening: &Opening,
    newest: Option<u64>,
    limits: &Limits,
) -> Result<Frame, Refusal> {
    sequence(wire.sequence, newest)?;
    let intrinsics = opening.intrinsics;
    let pose = pose(wire, opening.estimates_poses)?;
    let covariance = covariance(&wire.pose_covariance)?;
    let (world_from_camera, hint) = match pose {
        Some(world_from_camera) if opening.estimates_poses => {
            (None, Some(Box::new(PoseHint { world_from_camera, covariance })))
        }
        given => (given, None),
    };
    let rgb = color::decode(wire.color_format, &wire.color, intrinsics.width, intrinsics.height)?;
    let depth_metres = depth::decode(wire, opening, limits)?;
    let labels = labels::decode(wire, opening)?;
    Ok(Frame {
        sequence: wire.sequence,
        timestamp_nanos: wire.timestamp_nanos,
        intrinsics,
        rgb: rgb.into(),
        depth_metres: depth_metres.into(),
        world_from_camera,
        hint,
        labels,
        held_out: wire.held_out,
    })
}

/// Checks that a frame is newer than the one before.
fn sequence(found: u64, newest: Option<u64>) -> Result<(), Refusal> {
    match newest {
        Some(newest) if found <= newest => Err(Refusal::new(
            "sequence",
            format!("expected more than {newest}, the newest frame's, found {found}"),
        )),
        _ => Ok(()),
    }
}

/// The frame's pose, which may only be missing if the server is to track.
fn pose(wire: &v1::Frame, may_miss: bool) -> Result<Option<Isometry3<f64>>, Refusal> {
    const FIELD: &str = "world_from_camera";
    match &wire.world_from_camera {
        Some(pose) => wire_pose(FIELD, pose).map(Some),
        None if may_miss => Ok(None),
        None => Err(Refusal::new(FIELD, "missing: the stream was opened with POSE_SOURCE_GIVEN")),
    }
}

/// A covariance is 36 finite numbers, symmetric, with no negative variance in any direction; or
/// nothing.
fn covariance(numbers: &[f64]) -> Result<Option<Matrix6<f64>>, Refusal> {
    let refuse = |reason: String| Err(Refusal::new("pose_covariance", reason));
    if numbers.is_empty() {
        return Ok(None);
    }
    if numbers.len() != COVARIANCE_NUMBERS {
        return refuse(format!("expected 0 or 36 numbers, found {}", numbers.len()));
    }
    if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
        return refuse(format!("expected finite numbers, found {} at {at}", numbers[at]));
    }
    for row in 0..6 {
        if numbers[row * 7] < 0.0 {
            return refuse(format!("expected variances of at least 0, found {}", numbers[row * 7]));
        }
        for column in 0..row {
            let (a, b) = (numbers[row * 6 + column], numbers[column * 6 + row]);
            if (a - b).abs() > 1e-6 * (1.0 + a.abs()) {
                return refuse(format!(
                    "expected a symmetric matrix, found {a} at ({row}, {column}) and {b} across"
                ));
            }
        }
    }
    let matrix = Matrix6::from_row_slice(numbers);
    let matrix = (matrix + matrix.transpose()) * 0.5;
    let variances = matrix.symmetric_eigenvalues();
    if variances.min() < -1e-6 * variances.max() {
        return refuse(format!("expected no negative eigenvalue, found {}", variances.min()));
    }
    Ok(Some(matrix))
}

/// Checks wire intrinsics; `field` is where they stand.
///
/// # Errors
/// [`Refusal`] names the number at fault.
pub fn wire_intrinsics(
    field: &str,
    wire: &v1::Intrinsics,
    max_pixels: u64,
) -> Result<Intrinsics, Refusal> {
    let v1::Intrinsics { width, height, fx, fy, cx, cy } = *wire;
    camera::intrinsics(field, Intrinsics { width, height, fx, fy, cx, cy }, max_pixels)
}

/// Checks a wire pose; `field` is where it stands.
///
/// # Errors
/// [`Refusal`] names the part at fault.
pub fn wire_pose(field: &str, wire: &v1::Pose) -> Result<Isometry3<f64>, Refusal> {
    let missing = |part| Refusal::new(format!("{field}.{part}"), "missing");
    let rotation = wire.rotation.as_ref().ok_or_else(|| missing("rotation"))?;
    let translation =
        wire.translation_metres.as_ref().ok_or_else(|| missing("translation_metres"))?;
    camera::pose(
        field,
        [rotation.w, rotation.x, rotation.y, rotation.z],
        [translation.x, translation.y, translation.z],
    )
}

#[cfg(test)]
mod tests;
