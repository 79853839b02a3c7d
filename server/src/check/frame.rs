//! Frames of a stream.

use super::camera;
use super::cameras;
use super::color;
use super::depth;
use super::direction::direction;
use super::labels;
use super::limits::Limits;
use super::opening::Opening;
use super::refusal::Refusal;
use crate::pipeline::frame::{Frame, FrameUp, PoseHint};
use crate::pipeline::registration::{self, RawFrame};
use lexsplat_proto::v1;
use nalgebra::{Isometry3, Matrix6};
use std::sync::Arc;

/// Numbers in a pose covariance: 6x6.
const COVARIANCE_NUMBERS: usize = 36;
/// Pixels of color with depth at least, as a share of the depth camera's.
const LEAST_SEEN: f64 = 0.01;
/// Longest time between color and depth of a frame, nanoseconds.
const LONGEST_LAG_NANOS: u64 = 500_000_000;
/// Largest sequence number of a map's first frame.
const LARGEST_FIRST_SEQUENCE: u64 = 1 << 62;

/// Checks a frame and decodes its images.
///
/// `newest` is the sequence number of the last accepted frame of the map. Decoding takes
/// milliseconds: do not call this on an async thread.
///
/// # Errors
/// [`Refusal`] names the field.
pub(crate) fn frame(
    wire: &v1::Frame,
    opening: &Opening,
    newest: Option<u64>,
    limits: &Limits,
) -> Result<RawFrame, Refusal> {
    sequence(wire.sequence, newest, limits)?;
    let sent = opening.registration.cameras();
    let intrinsics = cameras::of_frame(wire.intrinsics.as_ref(), &sent.color.intrinsics, limits)?;
    let size = (intrinsics.width, intrinsics.height);
    let pose = pose(wire, opening.estimates_poses)?;
    let covariance = covariance(&wire.pose_covariance)?;
    // Without a pose or a hint the sender does not know the map's coordinates.
    let in_world = opening.up.filter(|_| pose.is_some());
    let up = FrameUp { in_world, in_camera: direction("up", wire.up.as_ref())? };
    let (world_from_camera, hint) = match pose {
        Some(world_from_camera) if opening.estimates_poses => {
            (None, Some(Box::new(PoseHint { world_from_camera, covariance })))
        }
        given => (given, None),
    };
    let rgb = color::decode(wire.color_format, &wire.color, size)?;
    let depth_metres = depth::decode(wire, opening)?;
    let labels = labels::decode(wire, size, &opening.label_texts)?;
    Ok(RawFrame(Frame {
        sequence: wire.sequence,
        timestamp_nanos: wire.timestamp_nanos,
        intrinsics,
        rgb: rgb.into(),
        depth_metres: depth_metres.into(),
        depth_lag_nanos: depth_lag(wire)?,
        world_from_camera,
        hint,
        labels,
        held_out: wire.held_out,
        up,
    }))
}

/// Registers a checked frame.
///
/// # Errors
/// [`Refusal`] if the lens does not fit the frame's own intrinsics, or if the color camera sees hardly any
/// of its depth: then the cameras' places are wrong.
pub(crate) fn registered(raw: RawFrame, opening: &Opening) -> Result<Frame, Refusal> {
    let sent = raw.0.depth_metres.clone();
    let frame = registration::registered(raw, &opening.registration)
        .map_err(|error| Refusal::new("intrinsics", error.to_string()))?;
    let is_moved = !Arc::ptr_eq(&sent, &frame.depth_metres);
    let measured = |depths: &[f32]| depths.iter().filter(|depth| **depth > 0.0).count() as f64;
    // A depth camera with more pixels than color cannot give each of them a place.
    let places = (frame.depth_metres.len() as f64 / sent.len().max(1) as f64).min(1.0);
    if is_moved && measured(&frame.depth_metres) < LEAST_SEEN * measured(&sent) * places {
        let reason = format!(
            "the color camera sees hardly any of it: {} of its pixels have depth, and {} of the depth camera's: is \
             depth_camera.color_from_depth right, in metres, and not inverted?",
            measured(&frame.depth_metres),
            measured(&sent)
        );
        return Err(Refusal::new("depth", reason));
    }
    Ok(frame)
}

/// How much later than color depth was taken, nanoseconds.
fn depth_lag(wire: &v1::Frame) -> Result<i64, Refusal> {
    let (color, depth) = (wire.timestamp_nanos, wire.depth_timestamp_nanos);
    if color == 0 || depth == 0 {
        return Ok(0);
    }
    let apart = color.abs_diff(depth);
    if apart > LONGEST_LAG_NANOS {
        let reason = format!(
            "expected depth within 0.5 s of color, found {:.3} s between them: do they belong together?",
            apart as f64 / 1e9
        );
        return Err(Refusal::new("depth_timestamp_nanos", reason));
    }
    // What is within half a second fits.
    Ok(if depth > color { apart as i64 } else { -(apart as i64) })
}

/// Checks that sequence numbers increase, and leave room for the frames to come.
fn sequence(found: u64, newest: Option<u64>, limits: &Limits) -> Result<(), Refusal> {
    let refuse = |reason: String| Err(Refusal::new("sequence", reason));
    let most = newest
        .map_or(LARGEST_FIRST_SEQUENCE, |newest| newest.saturating_add(limits.max_sequence_step));
    match newest {
        Some(newest) if found <= newest => {
            refuse(format!("expected more than {newest}, the newest frame's, found {found}"))
        }
        _ if found > most => refuse(format!(
            "expected at most {most}, found {found}: no later frame could follow a number that is far too large"
        )),
        _ => Ok(()),
    }
}

/// The frame's pose; it may be missing only if the server estimates poses.
fn pose(wire: &v1::Frame, may_be_missing: bool) -> Result<Option<Isometry3<f64>>, Refusal> {
    const FIELD: &str = "world_from_camera";
    match &wire.world_from_camera {
        Some(pose) => camera::pose_from_wire(FIELD, pose).map(Some),
        None if may_be_missing => Ok(None),
        None => Err(Refusal::new(FIELD, "missing: the stream was opened with POSE_SOURCE_GIVEN")),
    }
}

/// A 6x6 pose covariance, or nothing. It must be finite, symmetric and positive semi-definite.
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
                    "expected a symmetric matrix, found {a} at ({row}, {column}) and {b} at \
                     ({column}, {row})"
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
