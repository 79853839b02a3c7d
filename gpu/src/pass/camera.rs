//! A pinhole camera: x right, y down, z forward; the centre of the top-left pixel is (0, 0).

use nalgebra::{Isometry3, Point3};

use crate::device::GpuError;
use crate::shader::Tiling;
use crate::shader::layout::{PassArguments, VIEW_MARGIN};

/// Intrinsics and pose of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Columns, in pixels.
    pub width: u32,
    /// Rows, in pixels.
    pub height: u32,
    /// Focal length along x, in pixels.
    pub fx: f32,
    /// Focal length along y, in pixels.
    pub fy: f32,
    /// Principal point, x, in pixels: the centre of the top-left pixel is 0.
    pub cx: f32,
    /// Principal point, y, in pixels.
    pub cy: f32,
    /// Pose: maps world points, metres, into the camera.
    pub camera_from_world: Isometry3<f32>,
}

impl Camera {
    /// The same view on another pixel grid. Pixel areas keep their place: the image's outer border,
    /// half a pixel outside of the first centre, is the fixed point.
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let (sx, sy) =
            (width as f32 / self.width.max(1) as f32, height as f32 / self.height.max(1) as f32);
        Camera {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: (self.cx + 0.5) * sx - 0.5,
            cy: (self.cy + 0.5) * sy - 0.5,
            camera_from_world: self.camera_from_world,
        }
    }

    /// Pixel (u, v) and depth z in metres of a world point; `None` if it is not in front.
    pub fn project(&self, point: &Point3<f32>) -> Option<(f32, f32, f32)> {
        let p = self.camera_from_world * point;
        (p.z > 0.0).then(|| (self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy, p.z))
    }

    /// The world point at pixel (u, v) and depth z in metres.
    pub fn unproject(&self, u: f32, v: f32, depth: f32) -> Point3<f32> {
        let x = (u - self.cx) / self.fx * depth;
        let y = (v - self.cy) / self.fy * depth;
        self.camera_from_world.inverse_transform_point(&Point3::new(x, y, depth))
    }

    /// Returns an error if the camera cannot render.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] unless the pose is finite, the focal lengths are positive and there is
    /// at least one pixel.
    pub fn check(&self) -> Result<(), GpuError> {
        let pose = self.camera_from_world.to_homogeneous();
        let finite = [self.cx, self.cy].iter().chain(pose.iter()).all(|value| value.is_finite());
        let focal = [self.fx, self.fy].iter().all(|f| f.is_finite() && *f > 0.0);
        let size = self.width > 0 && self.height > 0;
        if finite && focal && size {
            return Ok(());
        }
        let expected = "a finite pose, positive focal lengths and at least one pixel";
        Err(GpuError::BadValue { what: "camera", expected, found: format!("{self:?}") })
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Columns and rows of tiles.
    pub fn tiles(&self, tiling: Tiling) -> [u32; 2] {
        tiling.tiles([self.width, self.height])
    }

    /// Largest |x/z| and |y/z| at which the Jacobian is taken.
    pub fn jacobian_limit(&self) -> [f32; 2] {
        let limit = |size: u32, centre: f32, focal: f32| {
            let half = 0.5 * size as f32;
            let farthest = (centre + 0.5).abs().max((size as f32 - 0.5 - centre).abs());
            // The axis of a window of a larger picture may lie outside of the window.
            let reach = if farthest > VIEW_MARGIN * half { farthest } else { half };
            VIEW_MARGIN * reach / focal
        };
        [limit(self.width, self.cx, self.fx), limit(self.height, self.cy, self.fy)]
    }

    /// The uniform of a pass over `count` Gaussians whose lists hold `capacity` hits; its band is the
    /// whole picture.
    pub(crate) fn arguments(&self, tiling: Tiling, count: usize, capacity: usize) -> PassArguments {
        let m = self.camera_from_world.to_homogeneous();
        let tiles = self.tiles(tiling);
        let row = |i: usize| [m[(i, 0)], m[(i, 1)], m[(i, 2)], m[(i, 3)]];
        PassArguments {
            camera_x: row(0),
            camera_y: row(1),
            camera_z: row(2),
            focal: [self.fx, self.fy],
            centre: [self.cx, self.cy],
            limit: self.jacobian_limit(),
            size: [self.width, self.height],
            tiles,
            band: [0, tiles[1]],
            bands: 1,
            count: count as u32,
            capacity: capacity as u32,
            ..PassArguments::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    fn camera() -> Camera {
        Camera {
            width: 64,
            height: 48,
            fx: 50.0,
            fy: 55.0,
            cx: 31.5,
            cy: 23.5,
            camera_from_world: Isometry3::from_parts(
                Translation3::new(0.1, -0.2, 0.3),
                UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.2, -0.3)),
            ),
        }
    }

    #[test]
    fn unproject_undoes_project() {
        let camera = camera();
        let (u, v, z) = camera.project(&camera.unproject(12.25, 30.5, 2.5)).expect("in front");
        assert!((u - 12.25).abs() < 1e-3 && (v - 30.5).abs() < 1e-3 && (z - 2.5).abs() < 1e-5);
        assert!(camera.project(&camera.unproject(12.25, 30.5, -2.5)).is_none());
    }

    #[test]
    fn resizing_keeps_the_place_of_pixel_areas() {
        let camera = camera();
        let half = camera.resized(32, 24);
        let (u, v, _) = half.project(&camera.unproject(0.5, 0.5, 1.0)).expect("in front");
        assert!(u.abs() < 1e-4 && v.abs() < 1e-4, "pixels 0 and 1 share the new pixel 0: {u} {v}");
        assert_eq!(camera.resized(64, 48).cx, camera.cx);
    }

    #[test]
    fn a_window_is_drawn_with_the_limits_of_the_whole_picture() {
        let whole = camera();
        let [x, y] = whole.jacobian_limit();
        assert!((x - VIEW_MARGIN * 32.0 / 50.0).abs() < 1e-6, "{x}");
        assert!((y - VIEW_MARGIN * 24.0 / 55.0).abs() < 1e-6, "{y}");
        let right = Camera { width: 32, height: 24, cx: -0.5, cy: 23.5, ..whole.clone() };
        assert_eq!(right.jacobian_limit(), [x, y]);
        // A camera whose axis is nearly in the middle has the limit of one whose axis is.
        let real = Camera { cx: 33.0, cy: 20.0, ..whole };
        assert_eq!(real.jacobian_limit(), [x, y]);
    }
}
