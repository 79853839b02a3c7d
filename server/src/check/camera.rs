//! Cameras and poses, for frames, queries and rendered images.

use super::refusal::Refusal;
use crate::pipeline::frame::Intrinsics;
use lexsplat_proto::v1;
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Range of the focal length in image sides: fields of view from 168 down to 0.6 degrees.
const FOCAL_SIDES: std::ops::RangeInclusive<f64> = 0.05..=100.0;
/// How far the principal point may lie outside the image, in image sides.
const PRINCIPAL_SIDES_OUTSIDE: f64 = 1.0;
/// Largest error of a rotation: of the quaternion's norm, and of each entry of R Rᵀ - I.
const RIGID_TOLERANCE: f64 = 1e-3;
/// Largest coordinate of a position, metres. Single precision is too coarse beyond it.
const MAX_COORDINATE_METRES: f64 = 1e5;

/// Checks pinhole intrinsics from a gRPC message; `field` is their path in the message.
///
/// # Errors
/// [`Refusal`] names the number.
pub(super) fn from_wire(
    field: &str,
    wire: &v1::Intrinsics,
    max_pixels: u64,
) -> Result<Intrinsics, Refusal> {
    let v1::Intrinsics { width, height, fx, fy, cx, cy } = *wire;
    intrinsics(field, Intrinsics { width, height, fx, fy, cx, cy }, max_pixels)
}

/// Checks pinhole intrinsics; `field` is their path in the message.
///
/// # Errors
/// [`Refusal`] names the number.
pub(super) fn intrinsics(
    field: &str,
    camera: Intrinsics,
    max_pixels: u64,
) -> Result<Intrinsics, Refusal> {
    let refuse = |part: &str, reason: String| Err(Refusal::new(format!("{field}.{part}"), reason));
    let Intrinsics { width, height, fx, fy, cx, cy } = camera;
    for (part, side) in [("width", width), ("height", height)] {
        if side == 0 {
            return refuse(part, "expected at least 1 pixel, found 0".into());
        }
    }
    let pixels = u64::from(width) * u64::from(height);
    if pixels > max_pixels {
        return refuse(
            "width",
            format!("expected at most {max_pixels} pixels, found {width}x{height} = {pixels}"),
        );
    }
    let axes = [("fx", fx, "cx", cx, width), ("fy", fy, "cy", cy, height)];
    for (focal_part, focal, principal_part, principal, side) in axes {
        let side = f64::from(side);
        // This form of the condition also refuses NaN.
        if !FOCAL_SIDES.contains(&(focal / side)) {
            let (least, most) = (FOCAL_SIDES.start() * side, FOCAL_SIDES.end() * side);
            return refuse(
                focal_part,
                format!(
                    "expected {least} to {most} pixels for an image side of {side}, found {focal}"
                ),
            );
        }
        let (least, most) =
            (-PRINCIPAL_SIDES_OUTSIDE * side, (1.0 + PRINCIPAL_SIDES_OUTSIDE) * side);
        if !(least..=most).contains(&principal) {
            return refuse(
                principal_part,
                format!("expected {least} to {most} pixels, found {principal}"),
            );
        }
    }
    Ok(camera)
}

/// Checks a pose from a gRPC message; `field` is its path in the message.
///
/// # Errors
/// [`Refusal`] names the part.
pub(super) fn pose_from_wire(field: &str, wire: &v1::Pose) -> Result<Isometry3<f64>, Refusal> {
    let missing = |part| Refusal::new(format!("{field}.{part}"), "missing");
    let rotation = wire.rotation.as_ref().ok_or_else(|| missing("rotation"))?;
    let translation =
        wire.translation_metres.as_ref().ok_or_else(|| missing("translation_metres"))?;
    pose(
        field,
        [rotation.w, rotation.x, rotation.y, rotation.z],
        [translation.x, translation.y, translation.z],
    )
}

/// Checks a pose from a quaternion (w, x, y, z) and a translation in metres.
///
/// # Errors
/// [`Refusal`] if a number is not finite, the quaternion does not have length 1, or the position is
/// too far from the origin.
fn pose(field: &str, wxyz: [f64; 4], translation: [f64; 3]) -> Result<Isometry3<f64>, Refusal> {
    let translation = position(&format!("{field}.translation_metres"), translation)?;
    let [w, x, y, z] = wxyz;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    let is_unit = (norm - 1.0).abs() <= RIGID_TOLERANCE;
    // This form of the condition also refuses NaN.
    if !is_unit {
        let reason = format!("expected a quaternion (w, x, y, z) of length 1, found length {norm}");
        return Err(Refusal::new(format!("{field}.rotation"), reason));
    }
    Ok(Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(quaternion)))
}

/// Checks a pose from a row-major 4x4 matrix, metres.
///
/// # Errors
/// [`Refusal`] if it is not a rigid transform.
pub(super) fn pose_from_matrix(field: &str, rows: &[f64]) -> Result<Isometry3<f64>, Refusal> {
    let refuse = |reason: String| Err(Refusal::new(field, reason));
    let &[a, b, c, x, d, e, f, y, g, h, i, z, p, q, r, s] = rows else {
        return refuse(format!("expected 16 numbers, row-major, found {}", rows.len()));
    };
    let last = [p, q, r, s];
    let wanted = [0.0, 0.0, 0.0, 1.0];
    if !last.iter().zip(wanted).all(|(found, want)| (found - want).abs() <= RIGID_TOLERANCE) {
        return refuse(format!(
            "expected 0 0 0 1 in the last row (row-major order), found {p} {q} {r} {s}"
        ));
    }
    let rotation = Matrix3::new(a, b, c, d, e, f, g, h, i);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    if !(off <= RIGID_TOLERANCE && rotation.determinant() > 0.0) {
        return refuse(format!(
            "expected a rotation in the upper left 3x3, found one that is off by {off:.4} with \
             determinant {:.4}",
            rotation.determinant()
        ));
    }
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok(Isometry3::from_parts(position(field, [x, y, z])?, rotation))
}

fn position(field: &str, [x, y, z]: [f64; 3]) -> Result<Translation3<f64>, Refusal> {
    let far = Vector3::new(x, y, z).map(f64::abs);
    // This form of the condition also refuses NaN.
    if !far.iter().all(|metres| *metres <= MAX_COORDINATE_METRES) {
        let reason = format!(
            "expected finite metres within {MAX_COORDINATE_METRES} of the origin, found {x} {y} {z}"
        );
        return Err(Refusal::new(field, reason));
    }
    Ok(Translation3::new(x, y, z))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Intrinsics =
        Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 319.5, cy: 239.5 };

    fn field_of(camera: Intrinsics) -> String {
        intrinsics("intrinsics", camera, 1 << 20).unwrap_err().field
    }

    #[test]
    fn good_intrinsics_pass_and_absurd_ones_name_the_number() {
        assert_eq!(intrinsics("intrinsics", GOOD, 1 << 20).unwrap(), GOOD);
        assert_eq!(field_of(Intrinsics { width: 0, ..GOOD }), "intrinsics.width");
        assert_eq!(field_of(Intrinsics { height: 0, ..GOOD }), "intrinsics.height");
        assert_eq!(field_of(Intrinsics { width: u32::MAX, ..GOOD }), "intrinsics.width");
        for fx in [0.0, -600.0, f64::NAN, f64::INFINITY, 1.0, 1e9] {
            assert_eq!(field_of(Intrinsics { fx, ..GOOD }), "intrinsics.fx", "{fx}");
        }
        assert_eq!(field_of(Intrinsics { fy: f64::NAN, ..GOOD }), "intrinsics.fy");
        assert_eq!(field_of(Intrinsics { cx: f64::NAN, ..GOOD }), "intrinsics.cx");
        assert_eq!(field_of(Intrinsics { cy: 1e6, ..GOOD }), "intrinsics.cy");
    }

    #[test]
    fn good_poses_pass_and_others_do_not() {
        let half = 0.5_f64.sqrt();
        let good = pose("p", [half, 0.0, half, 0.0], [1.0, 2.0, 3.0]).unwrap();
        assert!((good * Vector3::z() - Vector3::x()).norm() < 1e-12);
        pose("p", [1.0005, 0.0, 0.0, 0.0], [0.0; 3]).unwrap();
        for wxyz in [[0.0; 4], [1.1, 0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0, 1.0], [f64::INFINITY; 4]]
        {
            assert_eq!(pose("p", wxyz, [0.0; 3]).unwrap_err().field, "p.rotation", "{wxyz:?}");
        }
        for x in [f64::NAN, f64::INFINITY, 1e9] {
            let error = pose("p", [1.0, 0.0, 0.0, 0.0], [x, 0.0, 0.0]).unwrap_err();
            assert_eq!(error.field, "p.translation_metres", "{x}");
        }
    }

    #[test]
    fn matrices_must_be_rigid_and_row_major() {
        let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.1));
        let rows: Vec<f64> = pose.to_homogeneous().transpose().as_slice().to_vec();
        let read = pose_from_matrix("m", &rows).unwrap();
        assert!((read.to_homogeneous() - pose.to_homogeneous()).amax() < 1e-12);

        let columns: Vec<f64> = pose.to_homogeneous().as_slice().to_vec();
        assert!(pose_from_matrix("m", &columns).unwrap_err().reason.contains("row-major"));
        let change = |at: usize, to: f64| {
            let mut changed = rows.clone();
            changed[at] = to;
            pose_from_matrix("m", &changed).unwrap_err()
        };
        assert!(change(0, 2.0).reason.contains("rotation"));
        assert!(change(5, f64::NAN).reason.contains("rotation"));
        assert!(change(3, f64::NAN).reason.contains("finite"));
        let mut mirrored = rows.clone();
        mirrored.iter_mut().take(3).for_each(|number| *number = -*number);
        assert!(pose_from_matrix("m", &mirrored).unwrap_err().reason.contains("determinant"));
        assert!(pose_from_matrix("m", &rows[..15]).unwrap_err().reason.contains("found 15"));
    }
}
