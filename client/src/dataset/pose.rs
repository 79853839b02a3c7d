//! Poses from text. Matrices are written with few digits, so each is projected to the nearest
//! rotation (by singular value decomposition) and refused if it is far from one.

use super::error::DatasetError;
use super::{files, text};
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;

/// Axes of the camera in a pose as it is written.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
pub(super) enum Axes {
    /// x right, y down, z forward.
    #[default]
    OpenCv,
    /// x right, y up, z back.
    OpenGl,
}

impl Axes {
    /// The pose of the same camera with axes x right, y down, z forward.
    pub(super) fn to_opencv(self, world_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        match self {
            Self::OpenCv => *world_from_camera,
            Self::OpenGl => world_from_camera * half_turn,
        }
    }
}

/// Largest change of an entry of a rotation, and of a quaternion's length, that passes.
const TOLERANCE: f64 = 1e-2;

/// A rigid transform from the text of a 4x4 matrix, or of its first three rows.
pub(super) fn from_rows(line: &str) -> Result<Isometry3<f64>, String> {
    if text::words(line).count() == 12 {
        let upper = text::numbers::<12>(line)?;
        let last = [0.0, 0.0, 0.0, 1.0];
        return from_matrix(&std::array::from_fn(|i| if i < 12 { upper[i] } else { last[i - 12] }));
    }
    from_matrix(&text::numbers(line)?)
}

/// The poses of a file with one matrix a line.
pub(super) fn lines(path: &Path) -> Result<Vec<Result<Isometry3<f64>, String>>, DatasetError> {
    let content = files::text(path)?;
    let pose = |(number, line): (usize, &str)| {
        from_rows(line).map_err(|reason| DatasetError::at_line(path, number, reason).to_string())
    };
    Ok(text::lines(&content).map(pose).collect())
}

/// A rigid transform from a 4x4 matrix, row by row.
pub(super) fn from_matrix(rows: &[f64; 16]) -> Result<Isometry3<f64>, String> {
    finite(rows)?;
    if rows[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(format!("expected a pose with last row 0 0 0 1, found {:?}", &rows[12..]));
    }
    let written = Matrix3::from_fn(|row, column| rows[4 * row + column]);
    let svd = written.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err("expected a rotation, found a matrix without singular vectors".into());
    };
    let nearest = u * v_t;
    let change = (nearest - written).amax();
    if nearest.determinant() < 0.0 || change > TOLERANCE {
        return Err(format!(
            "expected a rotation, found a matrix that is off by {change:.3} (determinant {:.3})",
            written.determinant()
        ));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest));
    Ok(Isometry3::from_parts(Translation3::new(rows[3], rows[7], rows[11]), rotation))
}

/// A rigid transform from `tx ty tz qx qy qz qw`.
pub(super) fn from_tum(numbers: &[f64; 7]) -> Result<Isometry3<f64>, String> {
    finite(numbers)?;
    let [x, y, z, i, j, k, w] = *numbers;
    let quaternion = Quaternion::new(w, i, j, k);
    if (quaternion.norm() - 1.0).abs() > TOLERANCE {
        let norm = quaternion.norm();
        return Err(format!("expected a quaternion of length 1, found length {norm:.3}"));
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    Ok(Isometry3::from_parts(Translation3::from(Vector3::new(x, y, z)), rotation))
}

fn finite(numbers: &[f64]) -> Result<(), String> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("expected finite numbers in a pose, found {number}")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(pose: &Isometry3<f64>) -> [f64; 16] {
        let m = pose.to_homogeneous();
        std::array::from_fn(|i| m[(i / 4, i % 4)])
    }

    fn some_pose() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.4, -1.1, 0.7))
    }

    #[test]
    fn rotations_with_few_digits_are_projected() {
        let rounded = rows(&some_pose()).map(|n| (n * 1000.0).round() / 1000.0);
        let pose = from_matrix(&rounded).unwrap();
        assert!(pose.rotation.angle_to(&some_pose().rotation) < 2e-3);
        assert!((pose.translation.vector - some_pose().translation.vector).norm() < 1e-9);
        let m = pose.rotation.to_rotation_matrix();
        assert!((m.matrix() * m.matrix().transpose() - Matrix3::identity()).amax() < 1e-12);
    }

    #[test]
    fn matrices_far_from_a_rotation_are_refused() {
        let good = rows(&some_pose());
        let changed = |at: usize, to: f64| {
            let mut rows = good;
            rows[at] = to;
            from_matrix(&rows).unwrap_err()
        };
        assert!(changed(0, good[0] + 0.1).contains("off by"));
        assert!(changed(3, f64::NAN).contains("NaN"));
        assert!(changed(12, 1.0).contains("last row"));
        let mirrored: [f64; 16] =
            std::array::from_fn(|i| if i % 4 == 0 { -good[i] } else { good[i] });
        assert!(from_matrix(&mirrored).unwrap_err().contains("determinant -1"));
        assert!(from_matrix(&[f64::NEG_INFINITY; 16]).unwrap_err().contains("inf"));
    }

    #[test]
    fn quaternions_end_with_w() {
        let pose = some_pose();
        let (t, q) = (pose.translation, pose.rotation);
        let numbers = [t.x, t.y, t.z, q.i, q.j, q.k, q.w];
        assert!((from_tum(&numbers).unwrap().rotation.angle_to(&q)) < 1e-9);
        assert!(from_tum(&[0.0; 7]).unwrap_err().contains("length 0.000"));
    }
}
