//! Shaking of a camera: turns about its three axes on top of a smooth path, as of an unsteady hand
//! or a rough floor. A sum of sines between 1.5 and 9 Hz for 30 frames per second, so that the
//! camera's velocity is smooth too. In and out: poses `world_from_camera`; positions stay.

use crate::dice::Dice;
use lexsplat_client::dataset::counted_nanos;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Frequencies, hertz: sway of the arm, steps, and tremor of the hand (about 8 to 12 Hz in healthy
/// adults; lower here, so that 30 frames per second show it).
const HERTZ: [f64; 3] = [1.7, 4.3, 8.9];
/// Share of each frequency in the mean square.
const SHARES: [f64; 3] = [0.5, 0.3, 0.2];

/// The poses with shaking of this root mean square about each axis.
pub(crate) fn shaken(
    path: Vec<Isometry3<f64>>,
    seed: u64,
    rms_radians: f64,
) -> Vec<Isometry3<f64>> {
    if rms_radians == 0.0 {
        return path;
    }
    let mut dice = Dice::new(seed ^ 0x5AE0);
    let mut phase = || f64::from(dice.between(0.0, std::f32::consts::TAU));
    let phases: [[f64; 3]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| phase()));
    let turn = |seconds: f64| {
        let angle = |axis: usize| {
            let wave = |i: usize| {
                let amplitude = (2.0 * SHARES[i]).sqrt();
                amplitude * (TAU * HERTZ[i] * seconds + phases[axis][i]).sin()
            };
            rms_radians * (0..3).map(wave).sum::<f64>()
        };
        UnitQuaternion::from_scaled_axis(Vector3::from_fn(|axis, _| angle(axis)))
    };
    let seconds = |frame: usize| counted_nanos(frame as u64) as f64 * 1e-9;
    path.into_iter().enumerate().map(|(frame, pose)| pose * turn(seconds(frame))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaking_has_the_given_size_and_moves_nothing() {
        let path = vec![Isometry3::translation(1.0, 2.0, 3.0); 900];
        assert_eq!(shaken(path.clone(), 7, 0.0), path);
        let rms = 0.02;
        let found = shaken(path.clone(), 7, rms);
        assert_eq!(found, shaken(path.clone(), 7, rms), "the same seed shakes the same");
        assert_ne!(found, shaken(path, 8, rms));
        assert!(found.iter().all(|pose| pose.translation.vector == Vector3::new(1.0, 2.0, 3.0)));
        let square = |pose: &Isometry3<f64>| pose.rotation.scaled_axis().norm_squared() / 3.0;
        let measured = (found.iter().map(square).sum::<f64>() / 900.0).sqrt();
        assert!((measured / rms - 1.0).abs() < 0.05, "{measured}");
    }
}
