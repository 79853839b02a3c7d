//! A frame at the resolution at which it is tracked or mapped.
//!
//! In: a checked [`Frame`] and a number of columns. Out: a [`DownsampledFrame`], smaller by a whole
//! factor. Color is the mean of each block of pixels. Depth is the mean of the block's nearest surface.

use super::frame::{Frame, rasteriser_camera};
use super::saving::{CameraFields, packed};
use lexsplat_gpu::Camera;
use lexsplat_pictures::{Picture, smaller, without_gaps};
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A point lies on the measured surface if its depth differs by at most this share.
const ON_SURFACE: f32 = 0.05;

/// Color and depth of a frame at reduced resolution. Cloning shares the pixels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct DownsampledFrame {
    /// Size, intrinsics and pose of the reduced image.
    #[serde(with = "CameraFields")]
    pub camera: Camera,
    /// `[height * width * 3]`, row-major RGB, 8 bit.
    #[serde(with = "packed")]
    pub rgb: Arc<[u8]>,
    /// `[height * width]`, metres; 0 where nothing was measured.
    #[serde(with = "packed")]
    pub depth_metres: Arc<[f32]>,
}

impl DownsampledFrame {
    /// Reduces a frame to at most `max_columns` columns. Rows and columns at the border that do not fill
    /// a whole block are left out.
    pub fn new(frame: &Frame, world_from_camera: &Isometry3<f64>, max_columns: u32) -> Self {
        let full = rasteriser_camera(&frame.intrinsics, world_from_camera);
        let factor = factor(frame, max_columns);
        if factor == 1 {
            return Self {
                camera: full,
                rgb: frame.rgb.clone(),
                depth_metres: frame.depth_metres.clone(),
            };
        }
        let ([width, height], rgb, depth_metres) =
            smaller(&picture(&full, &frame.rgb, &frame.depth_metres), factor);
        let scale = 1.0 / factor as f32;
        let camera = Camera {
            width: width as u32,
            height: height as u32,
            fx: full.fx * scale,
            fy: full.fy * scale,
            cx: (full.cx + 0.5) * scale - 0.5,
            cy: (full.cy + 0.5) * scale - 0.5,
            camera_from_world: full.camera_from_world,
        };
        Self { camera, rgb: rgb.into(), depth_metres: depth_metres.into() }
    }

    /// The frame with thin gaps in depth closed that lie within one surface; the frame itself if it has none.
    pub fn without_gaps(self) -> Self {
        match without_gaps(&self.depth_metres, self.camera.width as usize) {
            Some(depth_metres) => Self { depth_metres: depth_metres.into(), ..self },
            None => self,
        }
    }

    /// Its pixels.
    pub fn picture(&self) -> Picture<'_> {
        picture(&self.camera, &self.rgb, &self.depth_metres)
    }

    /// The number of columns that [`DownsampledFrame::new`] reduces the frame to.
    pub fn columns(frame: &Frame, max_columns: u32) -> u32 {
        frame.intrinsics.width / factor(frame, max_columns) as u32
    }

    /// Color of a pixel, RGB from 0 to 1.
    pub fn color(&self, pixel: usize) -> [f32; 3] {
        std::array::from_fn(|channel| f32::from(self.rgb[pixel * 3 + channel]) / 255.0)
    }

    /// The point in the world that was measured at a pixel; `None` where nothing was.
    pub fn point(&self, pixel: usize) -> Option<Point3<f32>> {
        let width = self.camera.width as usize;
        let depth = self.depth_metres[pixel];
        let (u, v) = ((pixel % width) as f32, (pixel / width) as f32);
        (depth > 0.0).then(|| self.camera.unproject(u, v, depth))
    }

    /// Whether a point in the world lies on the surface that was measured at its pixel.
    pub fn shows(&self, point: &Point3<f32>) -> bool {
        self.place_of(point).is_some()
    }

    /// The color of a point in the world, RGB from 0 to 1, between the pixels around it; `None` if the image
    /// does not show the point.
    pub fn color_at(&self, point: &Point3<f32>) -> Option<[f32; 3]> {
        let [u, v] = self.place_of(point)?;
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let taps = |at: f32, size: usize| {
            let at = at.clamp(0.0, (size - 1) as f32);
            let low = at as usize;
            (low, (low + 1).min(size - 1), at - low as f32)
        };
        let (left, right, x) = taps(u, width);
        let (upper, lower, y) = taps(v, height);
        let row = |row: usize| {
            let (a, b) = (self.color(row * width + left), self.color(row * width + right));
            [0, 1, 2].map(|channel| a[channel] + (b[channel] - a[channel]) * x)
        };
        let (a, b) = (row(upper), row(lower));
        Some([0, 1, 2].map(|channel| a[channel] + (b[channel] - a[channel]) * y))
    }

    /// Where the image shows a point in the world, pixels; `None` if the point does not lie on the surface
    /// that was measured there.
    fn place_of(&self, point: &Point3<f32>) -> Option<[f32; 2]> {
        let (u, v, z) = self.camera.project(point)?;
        let (column, row) = (u.round(), v.round());
        let (width, height) = (self.camera.width as f32, self.camera.height as f32);
        if !(column >= 0.0 && row >= 0.0 && column < width && row < height) {
            return None;
        }
        let measured =
            self.depth_metres[row as usize * self.camera.width as usize + column as usize];
        // A hole has depth 0, so no point in front of the camera passes.
        ((z - measured).abs() <= ON_SURFACE * measured).then_some([u, v])
    }

    /// Changes the camera's pose.
    pub fn set_pose(&mut self, world_from_camera: &Isometry3<f64>) {
        self.camera.camera_from_world = world_from_camera.inverse().cast();
    }
}

/// Side of a block in pixels, at least 1.
fn factor(frame: &Frame, max_columns: u32) -> usize {
    frame.intrinsics.width.div_ceil(max_columns.max(1)).max(1) as usize
}

fn picture<'a>(camera: &Camera, rgb: &'a [u8], depth_metres: &'a [f32]) -> Picture<'a> {
    Picture {
        width: camera.width as usize,
        height: camera.height as usize,
        focal: [camera.fx, camera.fy],
        centre: [camera.cx, camera.cy],
        rgb,
        depth_metres,
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::{FrameUp, Intrinsics};
    use super::*;

    /// A frame whose columns differ in color, with one hole and one near pixel.
    fn frame(width: u32, height: u32) -> Frame {
        let pixels = (width * height) as usize;
        let mut depth_metres = vec![3.0; pixels];
        depth_metres[0] = 0.0;
        depth_metres[1] = 1.0;
        let column = |at: usize| (at as u32 % width) as u8;
        Frame {
            sequence: 0,
            timestamp_nanos: 0,
            intrinsics: Intrinsics { width, height, fx: 10.0, fy: 10.0, cx: 3.5, cy: 1.5 },
            rgb: (0..pixels).flat_map(|at| [column(at), 100, 200]).collect(),
            depth_metres: depth_metres.into(),
            depth_lag_nanos: 0,
            world_from_camera: Some(Isometry3::identity()),
            hint: None,
            labels: None,
            held_out: false,
            up: FrameUp::default(),
        }
    }

    #[test]
    fn shrinking_averages_color_and_keeps_the_nearest_surface() {
        let small = DownsampledFrame::new(&frame(8, 4), &Isometry3::identity(), 4);
        assert_eq!((small.camera.width, small.camera.height), (4, 2));
        assert_eq!(small.rgb[..3], [1, 100, 200], "columns 0 and 1: 0.5, rounded up");
        assert_eq!(small.depth_metres[0], 1.0, "the nearest, not the mean of 0, 1, 3 and 3");
        assert_eq!(small.depth_metres[1], 3.0);
    }

    #[test]
    fn shrinking_keeps_points_where_they_are() {
        let full = rasteriser_camera(&frame(8, 4).intrinsics, &Isometry3::identity());
        let small = DownsampledFrame::new(&frame(8, 4), &Isometry3::identity(), 4).camera;
        // The middle of the four top-left pixels is the middle of the small image's first pixel.
        let seen = full.unproject(0.5, 0.5, 2.0);
        let (u, v, _) = small.project(&seen).expect("it is in front of the camera");
        assert!(u.abs() < 1e-5 && v.abs() < 1e-5, "({u}, {v}) should be (0, 0)");
        let (wrong, _, _) = small.project(&full.unproject(0.0, 0.0, 2.0)).expect("in front");
        assert!(wrong.abs() > 0.1, "and the corner pixel alone is not");
    }

    #[test]
    fn a_picture_shows_its_surface_and_nothing_before_behind_or_beside_it() {
        let small = DownsampledFrame::new(&frame(8, 4), &Isometry3::identity(), 8);
        let at = |u, v, depth| small.shows(&small.camera.unproject(u, v, depth));
        assert!(at(4.0, 2.0, 3.0) && at(4.0, 2.0, 3.1));
        assert!(!at(4.0, 2.0, 2.0) && !at(4.0, 2.0, 4.0), "before and behind");
        assert!(!at(9.0, 2.0, 3.0) && !at(4.0, -1.0, 3.0), "beside");
        assert!(!at(0.0, 0.0, 3.0), "a hole");
        assert!(!small.shows(&Point3::new(0.0, 0.0, -3.0)), "behind the camera");
    }

    #[test]
    fn a_color_is_read_between_pixels() {
        let small = DownsampledFrame::new(&frame(8, 4), &Isometry3::identity(), 8);
        let red =
            |u| small.color_at(&small.camera.unproject(u, 2.0, 3.0)).map(|rgb| rgb[0] * 255.0);
        assert!((red(4.0).expect("shown") - 4.0).abs() < 1e-3);
        assert!((red(4.25).expect("shown") - 4.25).abs() < 1e-3);
        assert!(red(9.0).is_none(), "beside the picture");
        assert_eq!(small.point(0), None, "a hole");
        let point = small.point(12).expect("measured");
        assert!((point - small.camera.unproject(4.0, 1.0, 3.0)).norm() < 1e-6);
    }

    #[test]
    fn small_frames_stay_as_they_are() {
        let small = DownsampledFrame::new(&frame(8, 4), &Isometry3::identity(), 8);
        assert_eq!((small.camera.width, small.camera.height), (8, 4));
        assert_eq!(small.depth_metres[0], 0.0);
    }
}
