//! `trajectory.json`: a list of tracked frames, with the covariances of their poses.

use crate::pipeline::frame::TrackedFrame;
use nalgebra::SMatrix;
use serde::Serialize;
use utoipa::ToSchema;

/// A tracked frame.
#[derive(Serialize, ToSchema)]
pub(crate) struct TrajectoryEntry {
    sequence: u64,
    timestamp_nanos: u64,
    /// Row-major 4x4, metres.
    world_from_camera: Vec<f64>,
    /// Row-major 6x6, of a left perturbation [rho metres, theta radians]; relative to the map around it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_covariance: Option<Vec<f64>>,
}

/// One object for each tracked frame. Poses that were given have no covariance.
pub(super) fn trajectory_json(frames: &[TrackedFrame]) -> Vec<u8> {
    let entry = |frame: &TrackedFrame| TrajectoryEntry {
        sequence: frame.sequence,
        timestamp_nanos: frame.timestamp_nanos,
        world_from_camera: row_major(&frame.world_from_camera.to_homogeneous()),
        pose_covariance: frame.world_covariance().as_ref().map(row_major),
    };
    let entries: Vec<TrajectoryEntry> = frames.iter().map(entry).collect();
    serde_json::to_vec_pretty(&entries).expect("numbers are JSON")
}

fn row_major<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<f64> {
    matrix.transpose().as_slice().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Matrix6, Vector3};
    use serde_json::Value;

    #[test]
    fn estimated_poses_have_a_covariance_in_the_world() {
        let ahead = Vector3::new(0.0, 0.0, 2.0);
        let given = TrackedFrame {
            sequence: 4,
            timestamp_nanos: 5,
            world_from_camera: Isometry3::new(ahead, Vector3::y() * std::f64::consts::FRAC_PI_2),
            covariance: None,
            exposure: [0.0; 2],
        };
        let mut covariance = Matrix6::zeros();
        // The camera's z axis is the world's x axis.
        covariance[(2, 2)] = 0.25;
        covariance[(0, 2)] = 0.125;
        covariance[(2, 0)] = 0.125;
        let estimated = TrackedFrame { sequence: 6, covariance: Some(covariance), ..given };
        let text: Value = serde_json::from_slice(&trajectory_json(&[given, estimated])).unwrap();
        assert!(text[0].get("pose_covariance").is_none(), "{text}");
        assert_eq!((&text[0]["sequence"], &text[0]["timestamp_nanos"]), (&4.into(), &5.into()));
        assert_eq!(text[0]["world_from_camera"][11], 2.0);
        let numbers = text[1]["pose_covariance"].as_array().unwrap();
        assert_eq!(numbers.len(), 36);
        let at = |row: usize, column: usize| numbers[6 * row + column].as_f64().unwrap();
        assert!((at(0, 0) - 0.25).abs() < 1e-12 && at(2, 2).abs() < 1e-12, "{numbers:?}");
        assert!((at(0, 2) + 0.125).abs() < 1e-12, "{numbers:?}");
    }
}
