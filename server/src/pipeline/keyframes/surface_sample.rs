//! Sampled surface points of a frame, and the share of them that other frames do not show.

use super::super::downsampled_frame::DownsampledFrame;
use lexsplat_gpu::Camera;
use nalgebra::Point3;

/// Points on the measured surface of a frame, in world coordinates.
pub(in super::super) struct SurfaceSample(Vec<Point3<f32>>);

impl SurfaceSample {
    /// Samples about `points` pixels on a regular grid; pixels without depth give no point.
    pub fn new(camera: &Camera, depth_metres: &[f32], points: f64) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let stride = ((width * height) as f64 / points).sqrt().ceil().max(1.0) as usize;
        let grid = |size| (stride / 2..size).step_by(stride);
        let points = grid(height).flat_map(|row| grid(width).map(move |column| (column, row)));
        let points = points.filter_map(|(column, row)| {
            let depth = depth_metres[row * width + column];
            (depth > 0.0).then(|| camera.unproject(column as f32, row as f32, depth))
        });
        Self(points.collect())
    }

    /// The share of the points that no frame shows, 0 to 1.
    pub fn novelty<'a>(&self, frames: impl Iterator<Item = &'a DownsampledFrame>) -> f64 {
        let frames: Vec<&DownsampledFrame> = frames.collect();
        let is_new = |point: &&Point3<f32>| !frames.iter().any(|frame| frame.shows(point));
        self.0.iter().filter(is_new).count() as f64 / self.0.len().max(1) as f64
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use nalgebra::Isometry3;

    const SAMPLES: f64 = 1000.0;

    /// Two metres of a wall 2 m away, seen from `metres` further to the right.
    pub fn wall(metres: f32) -> DownsampledFrame {
        let camera = Camera {
            width: 40,
            height: 30,
            fx: 40.0,
            fy: 40.0,
            cx: 19.5,
            cy: 14.5,
            camera_from_world: Isometry3::translation(-metres, 0.0, 0.0),
        };
        DownsampledFrame {
            camera,
            rgb: vec![128; 3600].into(),
            depth_metres: vec![2.0; 1200].into(),
        }
    }

    #[test]
    fn points_that_no_frame_shows_are_novel() {
        let here = wall(0.0);
        let sample = SurfaceSample::new(&here.camera, &here.depth_metres, SAMPLES);
        let (near, half, far) = (wall(0.1), wall(1.0), wall(5.0));
        let novelty = |frames: &[&DownsampledFrame]| sample.novelty(frames.iter().copied());
        assert_eq!((novelty(&[]), novelty(&[&far])), (1.0, 1.0));
        assert!(novelty(&[&far, &near]) < 0.1);
        assert!((novelty(&[&half]) - 0.5).abs() < 0.1, "half of it");
    }
}
