//! Reference, not for production: one Gaussian through one camera and back, in f64 and with plain
//! matrices, so that gradients can be held against finite differences without a device.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Rotation3, Vector2, Vector3, Vector4, Vector6};

use lexsplat_gpu::Camera;
use lexsplat_gpu::shader::layout::{DILATION, FAR, LOG_SCALE_LIMIT, MIN_ALPHA, NEAR};

/// A camera in f64.
#[derive(Clone, Debug)]
pub struct View {
    /// Rotation of `camera_from_world`.
    pub rotation: Matrix3<f64>,
    /// Translation of `camera_from_world`, metres.
    pub translation: Vector3<f64>,
    /// Focal lengths, pixels.
    pub focal: Vector2<f64>,
    /// Principal point, pixels.
    pub centre: Vector2<f64>,
    /// Largest |x/z| and |y/z| that the Jacobian sees.
    pub limit: Vector2<f64>,
    /// Columns and rows.
    pub size: [usize; 2],
}

/// One head's geometry of one Gaussian.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Centre in the world, metres.
    pub mean: Vector3<f64>,
    /// Quaternion (w, x, y, z), any length but zero.
    pub rotation: Vector4<f64>,
    /// Logarithms of the standard deviations, metres.
    pub log_scale: Vector3<f64>,
    /// Logit of the opacity.
    pub opacity_logit: f64,
}

/// A Gaussian as a camera sees it, or a gradient with respect to that.
#[derive(Clone, Debug)]
pub struct Splat {
    /// Centre, pixels.
    pub mean: Vector2<f64>,
    /// Inverse covariance.
    pub conic: Matrix2<f64>,
    /// Opacity.
    pub opacity: f64,
    /// z in the camera, metres.
    pub depth: f64,
}

impl View {
    /// The same camera.
    pub fn new(camera: &Camera) -> Self {
        let pose = camera.camera_from_world.cast::<f64>();
        Self {
            rotation: *pose.rotation.to_rotation_matrix().matrix(),
            translation: pose.translation.vector,
            focal: Vector2::new(camera.fx, camera.fy).cast(),
            centre: Vector2::new(camera.cx, camera.cy).cast(),
            limit: Vector2::from(camera.jacobian_limit()).cast(),
            size: [camera.width as usize, camera.height as usize],
        }
    }

    /// The camera after a left perturbation of `camera_from_world` by exp(tau), tau = (rho, theta).
    pub fn perturbed(&self, tau: &Vector6<f64>) -> Self {
        let theta: Vector3<f64> = tau.fixed_rows::<3>(3).into();
        let turn = *Rotation3::new(theta).matrix();
        // V of SE(3) up to the second order.
        let hat = theta.cross_matrix();
        let v = Matrix3::identity() + 0.5 * hat + hat * hat / 6.0;
        Self {
            rotation: turn * self.rotation,
            translation: turn * self.translation + v * tau.fixed_rows::<3>(0),
            ..self.clone()
        }
    }

    fn slope(&self, p: &Vector3<f64>) -> Vector2<f64> {
        let (x, y) = (p.x / p.z, p.y / p.z);
        Vector2::new(x.clamp(-self.limit.x, self.limit.x), y.clamp(-self.limit.y, self.limit.y))
    }

    /// Derivative of the pixel with respect to the camera point (EWA).
    fn jacobian(&self, p: &Vector3<f64>) -> Matrix2x3<f64> {
        let slope = self.slope(p);
        Matrix2x3::new(1.0, 0.0, -slope.x, 0.0, 1.0, -slope.y)
            .map_with_location(|row, _, value| value * self.focal[row] / p.z)
    }
}

/// Rotation of a quaternion (w, x, y, z) of length one.
fn rotation(q: &Vector4<f64>) -> Matrix3<f64> {
    let q = nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]);
    *nalgebra::UnitQuaternion::new_unchecked(q).to_rotation_matrix().matrix()
}

/// Derivatives of [`rotation`] with respect to w, x, y, z.
fn rotation_derivatives(q: &Vector4<f64>) -> [Matrix3<f64>; 4] {
    let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
    [
        Matrix3::new(0.0, -z, y, z, 0.0, -x, -y, x, 0.0) * 2.0,
        Matrix3::new(0.0, y, z, y, -2.0 * x, -w, z, w, -2.0 * x) * 2.0,
        Matrix3::new(-2.0 * y, x, w, x, 0.0, z, -w, z, -2.0 * y) * 2.0,
        Matrix3::new(-2.0 * z, -w, x, w, -2.0 * z, y, x, y, 0.0) * 2.0,
    ]
}

fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

fn scales(log_scale: &Vector3<f64>) -> Vector3<f64> {
    let limit = f64::from(LOG_SCALE_LIMIT);
    log_scale.map(|s| s.clamp(-limit, limit).exp())
}

/// Projects a Gaussian; `None` if it cannot be drawn.
pub fn forward(view: &View, shape: &Shape) -> Option<Splat> {
    let p = view.rotation * shape.mean + view.translation;
    let norm = shape.rotation.norm();
    let opacity = sigmoid(shape.opacity_logit);
    let usable = p.z > f64::from(NEAR)
        && p.z < f64::from(FAR)
        && norm > 1e-12
        && norm.is_finite()
        && opacity >= f64::from(MIN_ALPHA)
        && p.x.is_finite()
        && p.y.is_finite()
        && shape.log_scale.iter().all(|s| s.is_finite());
    if !usable {
        return None;
    }
    let local =
        rotation(&(shape.rotation / norm)) * Matrix3::from_diagonal(&scales(&shape.log_scale));
    let root = view.jacobian(&p) * view.rotation * local;
    let sigma = root * root.transpose() + Matrix2::identity() * f64::from(DILATION);
    let mean = view.focal.component_mul(&p.xy()) / p.z + view.centre;
    Some(Splat { mean, conic: sigma.try_inverse()?, opacity, depth: p.z })
}

/// Takes a gradient with respect to the splat (its conic's as a symmetric matrix) to the
/// parameters.
pub fn backward(view: &View, shape: &Shape, gradient: &Splat) -> Shape {
    let p = view.rotation * shape.mean + view.translation;
    let norm = shape.rotation.norm();
    let unit = shape.rotation / norm;
    let s = scales(&shape.log_scale);
    let turned = rotation(&unit);
    let local = turned * Matrix3::from_diagonal(&s);
    let jacobian = view.jacobian(&p);
    let root = jacobian * view.rotation * local;
    let sigma = root * root.transpose() + Matrix2::identity() * f64::from(DILATION);
    let conic = sigma.try_inverse().expect("the dilated covariance is positive definite");

    let d_sigma = -conic * gradient.conic * conic;
    let d_root = 2.0 * d_sigma * root;
    let d_local = view.rotation.transpose() * jacobian.transpose() * d_root;
    let d_jacobian = d_root * (view.rotation * local).transpose();
    let d_turned = d_local * Matrix3::from_diagonal(&s);
    let limit = f64::from(LOG_SCALE_LIMIT);
    let log_scale = Vector3::from_fn(|axis, _| {
        let inside = shape.log_scale[axis].abs() < limit;
        if inside { d_local.column(axis).dot(&turned.column(axis)) * s[axis] } else { 0.0 }
    });
    let derivatives = rotation_derivatives(&unit);
    let d_unit = Vector4::from_fn(|i, _| d_turned.dot(&derivatives[i]));
    let opacity = sigmoid(shape.opacity_logit);
    Shape {
        mean: view.rotation.transpose() * point_gradient(view, &p, gradient, &d_jacobian),
        rotation: (d_unit - unit * unit.dot(&d_unit)) / norm,
        log_scale,
        opacity_logit: gradient.opacity * opacity * (1.0 - opacity),
    }
}

/// Takes a gradient with respect to the splat to (rho, theta), a left perturbation of
/// `camera_from_world`: through the camera point, and through the rotation W in the covariance,
/// whose columns w turn by theta x w.
pub fn pose_backward(view: &View, shape: &Shape, gradient: &Splat) -> Vector6<f64> {
    let p = view.rotation * shape.mean + view.translation;
    let unit = shape.rotation / shape.rotation.norm();
    let local = rotation(&unit) * Matrix3::from_diagonal(&scales(&shape.log_scale));
    let jacobian = view.jacobian(&p);
    let root = jacobian * view.rotation * local;
    let sigma = root * root.transpose() + Matrix2::identity() * f64::from(DILATION);
    let conic = sigma.try_inverse().expect("the dilated covariance is positive definite");
    let d_root = -2.0 * conic * gradient.conic * conic * root;
    let d_jacobian = d_root * (view.rotation * local).transpose();
    let d_rotation = jacobian.transpose() * d_root * local.transpose();
    let d_point = point_gradient(view, &p, gradient, &d_jacobian);
    let mut d_theta = p.cross(&d_point);
    for axis in 0..3 {
        let column: Vector3<f64> = view.rotation.column(axis).into();
        d_theta += column.cross(&d_rotation.column(axis));
    }
    Vector6::new(d_point.x, d_point.y, d_point.z, d_theta.x, d_theta.y, d_theta.z)
}

/// dL/dp of the camera point: through the mean in the image, through depth, through the Jacobian.
fn point_gradient(
    view: &View,
    p: &Vector3<f64>,
    gradient: &Splat,
    d_jacobian: &Matrix2x3<f64>,
) -> Vector3<f64> {
    let slope = view.slope(p);
    let mut d_point = Vector3::new(0.0, 0.0, gradient.depth);
    for axis in 0..2 {
        let (f, z) = (view.focal[axis], p.z);
        d_point[axis] += gradient.mean[axis] * f / z;
        d_point.z -= gradient.mean[axis] * f * p[axis] / (z * z);
        d_point.z += (d_jacobian[(axis, 2)] * slope[axis] - d_jacobian[(axis, axis)]) * f / (z * z);
        if (p[axis] / z).abs() < view.limit[axis] {
            let d_slope = -d_jacobian[(axis, 2)] * f / z;
            d_point[axis] += d_slope / z;
            d_point.z -= d_slope * p[axis] / (z * z);
        }
    }
    d_point
}
