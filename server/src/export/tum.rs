//! `trajectory.tum`: lines of `timestamp tx ty tz qx qy qz qw`, camera-to-world.

use crate::pipeline::frame::TrackedFrame;
use std::fmt::Write as _;

const NANOS_PER_SECOND: u64 = 1_000_000_000;

/// One line for each tracked frame: seconds, metres, quaternion (x, y, z, w).
pub fn trajectory(frames: &[TrackedFrame]) -> String {
    let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for frame in frames {
        let (t, q) = (frame.world_from_camera.translation, frame.world_from_camera.rotation);
        let (whole, nanos) =
            (frame.timestamp_nanos / NANOS_PER_SECOND, frame.timestamp_nanos % NANOS_PER_SECOND);
        writeln!(
            text,
            "{whole}.{nanos:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            t.x, t.y, t.z, q.i, q.j, q.k, q.w
        )
        .expect("writing to a string does not fail");
    }
    text
}

/// A timestamp in seconds. For times since 1970 it is exact to about a microsecond.
pub fn seconds(timestamp_nanos: u64) -> f64 {
    timestamp_nanos as f64 / NANOS_PER_SECOND as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    #[test]
    fn lines_are_exact_to_the_nanosecond_and_quaternions_end_in_w() {
        let turn = Vector3::z() * std::f64::consts::PI;
        let frame = TrackedFrame {
            sequence: 3,
            timestamp_nanos: 1_700_000_000_000_000_001,
            world_from_camera: Isometry3::new(Vector3::new(1.0, -2.0, 0.5), turn),
            covariance: None,
            exposure: [0.0; 2],
        };
        let text = trajectory(&[frame]);
        let line = text.lines().nth(1).unwrap();
        let numbers: Vec<&str> = line.split(' ').collect();
        assert_eq!(numbers[0], "1700000000.000000001");
        assert_eq!(numbers[1..4], ["1.000000000", "-2.000000000", "0.500000000"]);
        assert_eq!(numbers[6], "1.000000000");
        assert_eq!(numbers[7].trim_start_matches('-'), "0.000000000");
        assert_eq!(seconds(1_500_000_000), 1.5);
    }
}
