//! What is known of a pose before its alignment, in the coordinates of that.

use lexsplat_gpu::align::Prior;
use lexsplat_gpu::align::se3::adjoint;
use nalgebra::{Isometry3, Matrix6};

/// Transforms a prior on `world_from_camera` into the base's frame. A left perturbation tau of the pose is
/// Ad tau there, where Ad is the adjoint of `base_from_world`.
pub(super) fn prior(
    base_from_world: &Isometry3<f64>,
    world_from_camera: &Isometry3<f64>,
    information: &Matrix6<f64>,
) -> Prior {
    let inverse = adjoint(&base_from_world.inverse());
    Prior {
        information: inverse.transpose() * information * inverse,
        reference_from_live: base_from_world * world_from_camera,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::align::se3;
    use nalgebra::Vector6;

    #[test]
    fn a_prior_costs_the_same_seen_from_anywhere() {
        let information = Matrix6::from_diagonal(&Vector6::new(1.0, 4.0, 9.0, 100.0, 400.0, 900.0));
        let expected = se3::exp(&Vector6::new(0.4, -0.2, 0.3, 0.5, -0.8, 0.2));
        let tau = Vector6::new(0.01, 0.02, -0.01, 0.005, -0.01, 0.02);
        let there = se3::exp(&tau) * expected;
        let cost = 0.5 * tau.dot(&(information * tau));
        let base = se3::exp(&Vector6::new(-0.3, 0.1, 0.9, 0.1, 0.7, -0.2));
        let seen = prior(&base, &expected, &information);
        let found = seen.cost(&(base * there));
        assert!((found - cost).abs() < 1e-6 * cost, "{found} {cost}");
        assert!(seen.cost(&(base * expected)).abs() < 1e-12);
        assert!((seen.cost(&there) - cost).abs() > 0.1 * cost, "the base matters");
    }
}
