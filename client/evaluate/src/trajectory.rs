//! The absolute trajectory error (ATE) after a rigid alignment (rotation and translation, no
//! scale), as `evo_ape tum -a` computes it; metres.
//!
//! Alignment: the least-squares one (Umeyama 1991 with scale 1), by B. Horn, "Closed-form solution
//! of absolute orientation using unit quaternions" (1987): the eigenvector of a symmetric 4x4
//! matrix, which is never a reflection. Frames are paired by their exact times; estimated frames
//! without a true pose do not count.

use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;
use std::collections::HashMap;

const NANOS_DIGITS: usize = 9;
const NANOS_PER_SECOND: u64 = 1_000_000_000;

/// A camera pose with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Time, nanoseconds.
    pub nanos: u64,
    /// Pose, metres.
    pub world_from_camera: Isometry3<f64>,
}

/// Position errors of an aligned trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ate {
    /// Root mean square, centimetres.
    pub rmse_cm: f64,
    /// Mean, centimetres.
    pub mean_cm: f64,
    /// Median, centimetres.
    pub median_cm: f64,
    /// Maximum, centimetres.
    pub max_cm: f64,
    /// Number of frames with both poses.
    pub frames: usize,
}

/// Reads lines `timestamp tx ty tz qx qy qz qw`; times are exact to the nanosecond.
///
/// # Errors
/// A message that names the malformed line.
pub fn read_tum(text: &str) -> Result<Vec<StampedPose>, String> {
    let lines = text.lines().enumerate();
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let parse = |(at, line): (usize, &str)| {
        let wrong = || format!("trajectory line {}: expected time and 7 numbers: {line:?}", at + 1);
        let (time, rest) = line.split_once(' ').ok_or_else(wrong)?;
        let nanos = nanos(time).ok_or_else(wrong)?;
        let numbers: Result<Vec<f64>, _> = rest.split_whitespace().map(str::parse).collect();
        let [x, y, z, i, j, k, w] = numbers.map_err(|_| wrong())?[..] else { return Err(wrong()) };
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
        let world_from_camera = Isometry3::from_parts(Translation3::new(x, y, z), rotation);
        Ok(StampedPose { nanos, world_from_camera })
    };
    lines.map(parse).collect()
}

/// `12.5` is 12 500 000 000.
fn nanos(time: &str) -> Option<u64> {
    let (whole, part) = time.split_once('.').unwrap_or((time, ""));
    let part = part.get(..NANOS_DIGITS.min(part.len()))?;
    let scaled = format!("{part:0<NANOS_DIGITS$}").parse::<u64>().ok()?;
    whole.parse::<u64>().ok()?.checked_mul(NANOS_PER_SECOND)?.checked_add(scaled)
}

/// The frames with both poses, as `[estimate, truth]`, in the order of the estimate.
pub fn paired(estimate: &[StampedPose], truth: &[StampedPose]) -> Vec<[StampedPose; 2]> {
    let by_time: HashMap<u64, &StampedPose> = truth.iter().map(|pose| (pose.nanos, pose)).collect();
    let pair = |pose: &StampedPose| by_time.get(&pose.nanos).map(|truth| [*pose, **truth]);
    estimate.iter().filter_map(pair).collect()
}

/// The rigid `truth_from_estimate` with the least sum of squared position errors.
pub fn align(pairs: &[[StampedPose; 2]]) -> Isometry3<f64> {
    let position = |pose: &StampedPose| pose.world_from_camera.translation.vector;
    let count = pairs.len().max(1) as f64;
    let mean = |side: usize| -> Vector3<f64> {
        pairs.iter().map(|pair| position(&pair[side])).sum::<Vector3<f64>>() / count
    };
    let (estimate_mean, truth_mean) = (mean(0), mean(1));
    let mut s = Matrix3::zeros();
    for [estimate, truth] in pairs {
        s += (position(estimate) - estimate_mean) * (position(truth) - truth_mean).transpose();
    }
    let [x, y, z] = [s[(1, 2)] - s[(2, 1)], s[(2, 0)] - s[(0, 2)], s[(0, 1)] - s[(1, 0)]];
    let sum = |row: usize, column: usize| s[(row, column)] + s[(column, row)];
    let (xx, yy, zz) = (s[(0, 0)], s[(1, 1)], s[(2, 2)]);
    #[rustfmt::skip]
    let n = Matrix4::new(
        xx + yy + zz, x,            y,            z,
        x,            xx - yy - zz, sum(0, 1),    sum(0, 2),
        y,            sum(0, 1),    yy - xx - zz, sum(1, 2),
        z,            sum(0, 2),    sum(1, 2),    zz - xx - yy,
    );
    let eigen = n.symmetric_eigen();
    let best = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let quaternion = Quaternion::new(best[0], best[1], best[2], best[3]);
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    let translation = truth_mean - rotation * estimate_mean;
    Isometry3::from_parts(translation.into(), rotation)
}

/// Position errors after alignment; `None` if there are no frames.
pub fn ate(pairs: &[[StampedPose; 2]]) -> Option<Ate> {
    let truth_from_estimate = align(pairs);
    let distance = |[estimate, truth]: &[StampedPose; 2]| {
        let aligned = truth_from_estimate * estimate.world_from_camera;
        (aligned.translation.vector - truth.world_from_camera.translation.vector).norm() * 100.0
    };
    let mut distances: Vec<f64> = pairs.iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let max_cm = *distances.last()?;
    let count = distances.len() as f64;
    let (low, high) = (distances[(distances.len() - 1) / 2], distances[distances.len() / 2]);
    Some(Ate {
        rmse_cm: (distances.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
        mean_cm: distances.iter().sum::<f64>() / count,
        median_cm: (low + high) / 2.0,
        max_cm,
        frames: distances.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(frame: usize, position: Vector3<f64>) -> StampedPose {
        let world_from_camera = Isometry3::new(position, Vector3::zeros());
        StampedPose { nanos: frame as u64 * 33_333_333, world_from_camera }
    }

    /// A curve, and the same with small errors seen from another world.
    fn curves() -> Vec<[StampedPose; 2]> {
        let other_from_truth =
            Isometry3::new(Vector3::new(3.0, -2.0, 0.5), Vector3::new(0.0, 0.0, 1.1));
        let pair = |frame: usize| {
            let i = frame as f64;
            let truth = Vector3::new((0.3 * i).sin(), (0.2 * i).cos(), 0.1 * i);
            let error = Vector3::new((7.0 * i).sin(), (5.0 * i).cos(), (3.0 * i + 1.0).sin());
            let seen = other_from_truth * nalgebra::Point3::from(truth + 0.02 * error);
            [at(frame, seen.coords), at(frame, truth)]
        };
        (0..40).map(pair).collect()
    }

    #[test]
    fn errors_are_those_of_evo() {
        // evo 1.x: PoseTrajectory3D of these formulas, est.align(ref), APE(translation_part).
        let found = ate(&curves()).unwrap();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        close(found.rmse_cm, 2.407_858_234_713_647);
        close(found.mean_cm, 2.346_811_812_806_671);
        close(found.median_cm, 2.421_680_669_820_041);
        close(found.max_cm, 3.208_482_474_705_48);
        assert_eq!(found.frames, 40);
    }

    #[test]
    fn one_wrong_frame_and_a_wrong_scale_are_errors() {
        let mut pairs = curves();
        pairs[7][0].world_from_camera.translation.vector += Vector3::new(0.0, 1.0, 0.0);
        assert!(ate(&pairs).unwrap().max_cm > 80.0);
        // Scale is not aligned: a trajectory of twice the size is far away.
        let mut pairs = curves();
        pairs.iter_mut().for_each(|pair| pair[0].world_from_camera.translation.vector *= 2.0);
        assert!(ate(&pairs).unwrap().rmse_cm > 50.0);
    }

    #[test]
    fn a_mirrored_trajectory_is_not_aligned_away() {
        let mut pairs = curves();
        pairs.iter_mut().for_each(|pair| pair[0].world_from_camera.translation.vector.x *= -1.0);
        assert!(ate(&pairs).unwrap().rmse_cm > 20.0);
        let rotation = align(&pairs).rotation.to_rotation_matrix();
        assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_rigid_motion_is_no_error() {
        // A quarter turn about z and a step along x, exactly.
        let truth = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 2.0, 3.0]];
        let pair = |(frame, [x, y, z]): (usize, [f64; 3])| {
            [at(frame, Vector3::new(5.0 - y, x, z)), at(frame, Vector3::new(x, y, z))]
        };
        let pairs: Vec<_> = truth.into_iter().enumerate().map(pair).collect();
        assert!(ate(&pairs).unwrap().max_cm < 1e-9);
        assert_eq!(ate(&[]), None);
        // One frame, or a camera that stands still, is always aligned.
        assert!(ate(&pairs[..1]).unwrap().max_cm < 1e-9);
    }

    #[test]
    fn times_are_exact_and_pair_frames() {
        let text = "# header\n1700000000.000000001 1 2 3 0 0 0 1\n1700000000.5 4 5 6 0 0 1 0\n";
        let poses = read_tum(text).unwrap();
        assert_eq!(poses[0].nanos, 1_700_000_000_000_000_001);
        assert_eq!(poses[1].nanos, 1_700_000_000_500_000_000);
        assert_eq!(poses[1].world_from_camera.translation.vector, Vector3::new(4.0, 5.0, 6.0));
        let truth = [StampedPose { nanos: poses[0].nanos + 1, ..poses[0] }, poses[1]];
        assert_eq!(paired(&poses, &truth), [[poses[1], poses[1]]]);
        for bad in ["x 1 2 3 0 0 0 1", "1.0 1 2 3", "1.0 1 2 3 0 0 0 one", "-1.0 1 2 3 0 0 0 1"] {
            assert!(read_tum(bad).unwrap_err().contains("line 1"), "{bad}");
        }
    }
}
