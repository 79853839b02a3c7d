//! Adam for a pose and an exposure (paper §3, as in MonoGS, the system that it builds on).
//!
//! In: gradients of the eight unknowns [rho, theta, a, b]. Out: steps of about 1 in each unknown, to be
//! scaled by learning rates.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

const FIRST_MOMENT: f64 = 0.9;
const SECOND_MOMENT: f64 = 0.999;
const EPSILON: f64 = 1e-15;

/// Adam's moments for [rho, theta, a, b].
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct PoseAdam {
    steps: i32,
    first: SVector<f64, 8>,
    second: SVector<f64, 8>,
}

impl PoseAdam {
    /// The step along the negative gradient, about 1 in each unknown.
    pub(super) fn step(&mut self, gradient: &SVector<f64, 8>) -> SVector<f64, 8> {
        self.steps = self.steps.saturating_add(1);
        self.first = self.first * FIRST_MOMENT + gradient * (1.0 - FIRST_MOMENT);
        let squared = gradient.component_mul(gradient);
        self.second = self.second * SECOND_MOMENT + squared * (1.0 - SECOND_MOMENT);
        let first = self.first / (1.0 - FIRST_MOMENT.powi(self.steps));
        let second = self.second / (1.0 - SECOND_MOMENT.powi(self.steps));
        first.zip_map(&second, |m, v| -m / (v.sqrt() + EPSILON))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_go_down_and_grow_small_at_the_bottom() {
        let bottom = SVector::<f64, 8>::from_fn(|i, _| 0.01 * i as f64);
        let mut at = SVector::<f64, 8>::repeat(0.05);
        let mut adam = PoseAdam::default();
        let first = adam.clone().step(&(at - bottom));
        assert!(first.iter().zip((at - bottom).iter()).all(|(s, g)| *s == 0.0 || s * g < 0.0));
        assert!(first.amax() <= 1.0 + 1e-6, "a step is about 1");
        for _ in 0..300 {
            at += adam.step(&(at - bottom)) * 1e-3;
        }
        assert!((at - bottom).amax() < 5e-3, "{}", (at - bottom).amax());
    }
}
