//! Axis-aligned and oriented boxes around points. The direction of gravity is unknown.

use nalgebra::{Matrix3, Point3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};

/// Share of the points at each end of an axis that lie outside the box, so that a few outliers do
/// not enlarge it.
const TRIMMED: f32 = 0.01;

/// Both boxes of a set of points, metres.
pub(super) struct FittedBoxes {
    /// Centre of the oriented box.
    pub center: Point3<f32>,
    /// Sides of the oriented box.
    pub size: Vector3<f32>,
    /// Orientation of the oriented box.
    pub world_from_box: UnitQuaternion<f32>,
    /// Least corner of the axis-aligned box.
    pub aabb_min: Point3<f32>,
    /// Greatest corner of the axis-aligned box.
    pub aabb_max: Point3<f32>,
}

/// The boxes of at least one point. The oriented one has the principal axes, or the world's if that
/// box is not larger.
pub(super) fn fit(points: &[Point3<f32>]) -> FittedBoxes {
    let aligned = UnitQuaternion::identity();
    let (aabb_min, aabb_max) = extent(points, &aligned);
    let principal = principal_axes(points);
    let (low, high) = extent(points, &principal);
    let volume = |size: Vector3<f32>| size.iter().product::<f32>();
    let (world_from_box, low, high) = if volume(high - low) < volume(aabb_max - aabb_min) {
        (principal, low, high)
    } else {
        (aligned, aabb_min, aabb_max)
    };
    let center = world_from_box * nalgebra::center(&low, &high);
    FittedBoxes { center, size: high - low, world_from_box, aabb_min, aabb_max }
}

/// Least and greatest corner along the axes of the box, without the trimmed points.
fn extent(
    points: &[Point3<f32>],
    world_from_box: &UnitQuaternion<f32>,
) -> (Point3<f32>, Point3<f32>) {
    let (mut low, mut high) = (Point3::origin(), Point3::origin());
    let in_box: Vec<_> = points.iter().map(|p| world_from_box.inverse_transform_point(p)).collect();
    let outside = (points.len() as f32 * TRIMMED) as usize;
    for axis in 0..3 {
        let mut along: Vec<f32> = in_box.iter().map(|point| point[axis]).collect();
        along.sort_by(f32::total_cmp);
        low[axis] = along[outside];
        high[axis] = along[along.len() - 1 - outside];
    }
    (low, high)
}

/// The principal axes, right-handed, longest first.
fn principal_axes(points: &[Point3<f32>]) -> UnitQuaternion<f32> {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f32>>() / points.len() as f32;
    let spread: Matrix3<f32> =
        points.iter().map(|p| p.coords - mean).map(|offset| offset * offset.transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [first, second] = [order[0], order[1]].map(|at| eigen.eigenvectors.column(at).into_owned());
    let axes = Matrix3::from_columns(&[first, second, first.cross(&second)]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lattice of points that fills a box with these sides.
    fn filled(
        sides: [f32; 3],
        turn: &UnitQuaternion<f32>,
        center: Point3<f32>,
    ) -> Vec<Point3<f32>> {
        let steps = 9;
        let along = |i: usize, side: f32| (i as f32 / (steps - 1) as f32 - 0.5) * side;
        (0..steps * steps * steps)
            .map(|i| {
                let at = [i % steps, i / steps % steps, i / steps / steps];
                let offset = Vector3::from_fn(|axis, _| along(at[axis], sides[axis]));
                center + turn * offset
            })
            .collect()
    }

    #[test]
    fn a_rotated_box_is_recovered() {
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.6);
        let center = Point3::new(1.0, -2.0, 0.5);
        let found = fit(&filled([2.0, 1.0, 0.4], &turn, center));
        assert!((found.center - center).norm() < 1e-3);
        assert!((found.size - Vector3::new(2.0, 1.0, 0.4)).norm() < 1e-2, "{}", found.size);
        let long = (found.world_from_box * Vector3::x()).dot(&(turn * Vector3::x()));
        assert!(long.abs() > 0.999, "{long}");
        // Negative control: its axis-aligned box is much larger.
        assert!((found.aabb_max - found.aabb_min).product() > 2.0 * found.size.product());
    }

    #[test]
    fn an_aligned_cube_and_a_single_point_have_aligned_boxes() {
        let found = fit(&filled([1.0; 3], &UnitQuaternion::identity(), Point3::origin()));
        assert_eq!(found.world_from_box, UnitQuaternion::identity());
        assert_eq!(found.aabb_max - found.aabb_min, found.size);
        let lone = fit(&[Point3::new(1.0, 2.0, 3.0)]);
        assert_eq!((lone.center, lone.size), (Point3::new(1.0, 2.0, 3.0), Vector3::zeros()));
    }

    #[test]
    fn an_outlier_does_not_enlarge_the_box() {
        let mut points = filled([1.0; 3], &UnitQuaternion::identity(), Point3::origin());
        points.push(Point3::new(9.0, 0.0, 0.0));
        assert!(fit(&points).aabb_max.x < 0.6);
    }
}
