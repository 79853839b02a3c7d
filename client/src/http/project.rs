//! Projection of 3D points into keyframes.

use lexsplat_proto::json::{Camera, Keyframe};

/// The pixel `(u, v)` and the depth in metres of a point of the world (metres) in a keyframe;
/// `None` if the point is behind the camera or outside the image.
pub fn project(keyframe: &Keyframe, point: [f64; 3]) -> Option<[f64; 3]> {
    let m = &keyframe.world_from_camera;
    let offset: [f64; 3] = std::array::from_fn(|row| point[row] - m[row * 4 + 3]);
    // The inverse of a rotation is its transpose.
    let [x, y, z] = std::array::from_fn(|column| {
        (0..3).map(|row| m[row * 4 + column] * offset[row]).sum::<f64>()
    });
    let Camera { width, height, fx, fy, cx, cy } = keyframe.camera;
    let (u, v) = (fx * x / z + cx, fy * y / z + cy);
    let inside = z > 0.0
        && (-0.5..f64::from(width) - 0.5).contains(&u)
        && (-0.5..f64::from(height) - 0.5).contains(&v);
    inside.then_some([u, v, z])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at `at` that looks along the world's x axis, with z up.
    fn keyframe(at: [f64; 3]) -> Keyframe {
        let [x, y, z] = at;
        #[rustfmt::skip]
        let world_from_camera = [
            0.0, 0.0, 1.0, x,
            -1.0, 0.0, 0.0, y,
            0.0, -1.0, 0.0, z,
            0.0, 0.0, 0.0, 1.0,
        ];
        Keyframe {
            sequence: 0,
            timestamp: 0.0,
            timestamp_nanos: 0,
            world_from_camera,
            camera: Camera { width: 65, height: 49, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0 },
            has_language: true,
        }
    }

    #[test]
    fn points_are_projected_or_outside() {
        let view = keyframe([1.0, 2.0, 3.0]);
        assert_eq!(project(&view, [3.0, 2.0, 3.0]), Some([32.0, 24.0, 2.0]));
        // To the left of the camera and above it: left of the image centre and above it.
        assert_eq!(
            project(&view, [3.0, 2.4, 3.2]).map(|p| p.map(f64::round)),
            Some([22.0, 19.0, 2.0])
        );
        assert_eq!(project(&view, [0.0, 2.0, 3.0]), None, "behind");
        assert_eq!(project(&view, [3.0, 5.0, 3.0]), None, "beside");
    }
}
