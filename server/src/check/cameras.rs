//! The cameras of a stream: intrinsics, lenses, and the place of the depth camera.

use super::camera;
use super::limits::Limits;
use super::refusal::Refusal;
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::registration::{
    Camera, Cameras, DepthCamera, Distortion, Registration, pinhole,
};
use lexsplat_proto::v1;
use nalgebra::Isometry3;

/// Largest distance between the color and the depth camera, metres.
const FARTHEST_APART: f64 = 10.0;
/// Most by which the shape of depth through color's lens may differ from color's: small pictures are rounded.
const MOST_OBLONG: f64 = 1.1;
/// Brown–Conrady coefficients that are used.
const BROWN_CONRADY: usize = 8;

/// Checks the cameras of an opening message.
///
/// # Errors
/// [`Refusal`] names the field.
pub(super) fn registration(open: &v1::OpenMap, limits: &Limits) -> Result<Registration, Refusal> {
    let wire = open.intrinsics.as_ref().ok_or_else(|| {
        Refusal::new("intrinsics", "missing: expected width, height, fx, fy, cx and cy in pixels")
    })?;
    let color = Camera {
        intrinsics: camera::from_wire("intrinsics", wire, limits.max_pixels)?,
        distortion: distortion("distortion", open.distortion.as_ref())?,
    };
    let depth =
        open.depth_camera.as_ref().map(|wire| depth_camera(wire, &color, limits)).transpose()?;
    if let Some(DepthCamera::Own { camera, .. }) = &depth {
        pinhole(camera)
            .map_err(|error| Refusal::new("depth_camera.distortion", error.to_string()))?;
    }
    Registration::new(Cameras { color, depth })
        .map_err(|error| Refusal::new("distortion", error.to_string()))
}

fn depth_camera(
    wire: &v1::DepthCamera,
    color: &Camera,
    limits: &Limits,
) -> Result<DepthCamera, Refusal> {
    const FIELD: &str = "depth_camera.intrinsics";
    let size = wire.intrinsics.as_ref().ok_or_else(|| {
        Refusal::new(FIELD, "missing: expected the width and height of depth images")
    })?;
    let v1::Intrinsics { width, height, fx, fy, cx, cy } = *size;
    let pose = wire.color_from_depth.as_ref();
    if [fx, fy, cx, cy] == [0.0; 4] {
        if pose.is_some() || wire.distortion.is_some() {
            let reason = "expected fx, fy, cx and cy of a depth camera that has a lens or a place of its own";
            return Err(Refusal::new(FIELD, reason));
        }
        // The focal length does not matter here: color's is used.
        let sides = (f64::from(width), f64::from(height));
        let any = v1::Intrinsics { width, height, fx: sides.0, fy: sides.1, cx: 0.0, cy: 0.0 };
        camera::from_wire(FIELD, &any, limits.max_pixels)?;
        let Intrinsics { width: columns, height: rows, .. } = color.intrinsics;
        let stretch = sides.0 / sides.1 * f64::from(rows) / f64::from(columns);
        if !(1.0 / MOST_OBLONG..=MOST_OBLONG).contains(&stretch) {
            let reason = format!(
                "expected depth of color's shape ({columns}x{rows}), found {width}x{height}: is it turned by 90 degrees, \
                 or does it see more or less than color and needs fx, fy, cx and cy of its own?"
            );
            return Err(Refusal::new(FIELD, reason));
        }
        return Ok(DepthCamera::SameLens { width, height });
    }
    let color_from_depth = match pose {
        Some(pose) => camera::pose_from_wire("depth_camera.color_from_depth", pose)?,
        None => Isometry3::identity(),
    };
    let apart = color_from_depth.translation.vector.norm();
    if apart > FARTHEST_APART {
        let reason = format!(
            "expected cameras at most {FARTHEST_APART} metres apart, found {apart}: is it in millimetres?"
        );
        return Err(Refusal::new("depth_camera.color_from_depth.translation_metres", reason));
    }
    let camera = Camera {
        intrinsics: camera::from_wire(FIELD, size, limits.max_pixels)?,
        distortion: distortion("depth_camera.distortion", wire.distortion.as_ref())?,
    };
    Ok(DepthCamera::Own { camera, color_from_depth })
}

fn distortion(field: &str, wire: Option<&v1::Distortion>) -> Result<Distortion, Refusal> {
    let refuse = |part: &str, reason: String| Err(Refusal::new(format!("{field}.{part}"), reason));
    let Some(wire) = wire else { return Ok(Distortion::None) };
    let found = &wire.coefficients;
    if let Some(at) = found.iter().position(|coefficient| !coefficient.is_finite()) {
        return refuse(
            "coefficients",
            format!("expected finite numbers, found {} at {at}", found[at]),
        );
    }
    let count = found.len();
    match v1::DistortionModel::try_from(wire.model) {
        Ok(v1::DistortionModel::Unspecified) if found.iter().all(|k| *k == 0.0) => {
            Ok(Distortion::None)
        }
        Ok(v1::DistortionModel::Unspecified) => {
            refuse("model", "missing: there are coefficients other than 0".into())
        }
        Ok(v1::DistortionModel::BrownConrady) => {
            let (used, unused) = found.split_at(count.min(BROWN_CONRADY));
            if !matches!(count, 4 | 5 | 8 | 12 | 14) {
                return refuse(
                    "coefficients",
                    format!("expected 4, 5 or 8 numbers, found {count}"),
                );
            }
            if unused.iter().any(|coefficient| *coefficient != 0.0) {
                let reason =
                    "expected 0 behind the first 8: thin prisms and tilted sensors are not known";
                return refuse("coefficients", reason.into());
            }
            let mut coefficients = [0.0; BROWN_CONRADY];
            coefficients[..used.len()].copy_from_slice(used);
            Ok(Distortion::BrownConrady(coefficients))
        }
        Ok(v1::DistortionModel::KannalaBrandt) => match found[..].try_into() {
            Ok(coefficients) => Ok(Distortion::KannalaBrandt(coefficients)),
            Err(_) => refuse("coefficients", format!("expected 4 numbers, found {count}")),
        },
        Err(_) => refuse(
            "model",
            format!(
                "unknown model {}, expected DISTORTION_MODEL_BROWN_CONRADY or _KANNALA_BRANDT",
                wire.model
            ),
        ),
    }
}

/// The color camera of one frame: its own one, or the usual one.
///
/// # Errors
/// [`Refusal`] if the frame's own camera is absurd or of another size.
pub(super) fn of_frame(
    wire: Option<&v1::Intrinsics>,
    usual: &Intrinsics,
    limits: &Limits,
) -> Result<Intrinsics, Refusal> {
    let Some(wire) = wire else { return Ok(*usual) };
    let own = camera::from_wire("intrinsics", wire, limits.max_pixels)?;
    if (own.width, own.height) != (usual.width, usual.height) {
        let reason = format!(
            "expected {}x{} as when the map was opened, found {}x{}",
            usual.width, usual.height, own.width, own.height
        );
        return Err(Refusal::new("intrinsics.width", reason));
    }
    Ok(own)
}
