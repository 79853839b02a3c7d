//! Exponential and logarithm of rigid motions, tau = [rho, theta] in metres and radians
//! (Sola, Deray, Atchuthan 2018, "A micro Lie theory", equations 172 to 175).

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// The motion of a twist: rotation Exp(theta), translation V(theta) rho.
pub fn exp(tau: &Vector6<f64>) -> Isometry3<f64> {
    let (rho, theta) = parts(tau);
    let rotation = UnitQuaternion::from_scaled_axis(theta);
    Isometry3::from_parts(Translation3::from(left_jacobian(&theta) * rho), rotation)
}

/// The twist of a motion with a rotation below half a turn.
pub fn log(motion: &Isometry3<f64>) -> Vector6<f64> {
    let theta = motion.rotation.scaled_axis();
    let inverse = left_jacobian(&theta).try_inverse().expect("V is regular below a whole turn");
    let rho = inverse * motion.translation.vector;
    Vector6::new(rho.x, rho.y, rho.z, theta.x, theta.y, theta.z)
}

/// The adjoint `[R, [t]x R; 0, R]`: T Exp(tau) = Exp(Ad tau) T for a twist tau.
pub fn adjoint(motion: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation: Matrix3<f64> = motion.rotation.to_rotation_matrix().into_inner();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    let cross = motion.translation.vector.cross_matrix();
    adjoint.fixed_view_mut::<3, 3>(0, 3).copy_from(&(cross * rotation));
    adjoint
}

/// (rho, theta) of a twist.
pub fn parts(tau: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (tau.fixed_rows::<3>(0).into_owned(), tau.fixed_rows::<3>(3).into_owned())
}

/// V = 1 + (1 - cos t)/t² [theta]x + (t - sin t)/t³ [theta]x², t = |theta|.
fn left_jacobian(theta: &Vector3<f64>) -> Matrix3<f64> {
    let squared = theta.norm_squared();
    let (first, second) = if squared < 1e-8 {
        (0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0)
    } else {
        let angle = squared.sqrt();
        ((1.0 - angle.cos()) / squared, (angle - angle.sin()) / (squared * angle))
    };
    let cross = theta.cross_matrix();
    Matrix3::identity() + first * cross + second * cross * cross
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_undoes_exp() {
        for scale in [0.0, 1e-9, 1e-5, 1e-4, 0.1, 1.0, 2.5] {
            let tau = Vector6::new(0.3, -0.5, 0.2, 0.6, -0.3, 0.74) * scale;
            assert!((log(&exp(&tau)) - tau).norm() < 1e-9 * (1.0 + scale), "scale {scale}");
        }
    }

    #[test]
    fn exp_is_the_limit_of_many_small_motions() {
        let tau = Vector6::new(0.3, -0.5, 0.2, 0.6, -0.3, 0.74);
        let small = exp(&(tau / 1024.0));
        let many = (0..1024).fold(Isometry3::identity(), |sum, _| small * sum);
        assert!((many.to_homogeneous() - exp(&tau).to_homogeneous()).norm() < 1e-9);
    }

    #[test]
    fn the_adjoint_carries_a_perturbation_to_the_other_side() {
        let motion = exp(&Vector6::new(0.4, -0.2, 0.3, 0.5, -0.8, 0.2));
        let tau = Vector6::new(0.1, 0.2, -0.1, 0.05, -0.1, 0.2);
        let left = motion * exp(&tau);
        let right = |tau: Vector6<f64>| exp(&tau) * motion;
        let off = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
            (a.to_homogeneous() - b.to_homogeneous()).norm()
        };
        assert!(off(&left, &right(adjoint(&motion) * tau)) < 1e-9);
        assert!(off(&left, &right(tau)) > 0.01, "it is not the same perturbation");
    }
}
