//! A frame at the size that it is tracked and mapped at.
//!
//! In: a checked [`Frame`] and a number of columns. Out: [`Working`], smaller by a whole-numbered
//! factor: color is the mean of each block, depth the mean of the block's nearest surface.

use super::frame::Frame;
use lexsplat_gpu::Camera;
use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

/// Depths of a block that lie within this share of its nearest are of one surface: of the mean of
/// all of them, points between surfaces would be made.
const ONE_SURFACE: f32 = 0.02;

/// A point whose depth is within this share of the measured one is what was measured.
const SAME_POINT: f32 = 0.05;

/// A frame at working size; cheap to clone.
#[derive(Clone, Debug)]
pub(super) struct Working {
    /// Size, intrinsics and pose.
    pub camera: Camera,
    /// `[height * width * 3]`.
    pub rgb: Arc<[u8]>,
    /// `[height * width]`, metres, 0 none.
    pub depth_metres: Arc<[f32]>,
}

impl Working {
    /// The frame with at most `columns` columns. Rows and columns that do not fill a block are left
    /// out.
    pub fn of(frame: &Frame, world_from_camera: &Isometry3<f64>, columns: u32) -> Self {
        let full = frame.intrinsics.camera(world_from_camera);
        let factor = factor(frame, columns);
        if factor == 1 {
            return Self {
                camera: full,
                rgb: frame.rgb.clone(),
                depth_metres: frame.depth_metres.clone(),
            };
        }
        let (width, height) =
            ((full.width as usize / factor).max(1), (full.height as usize / factor).max(1));
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
        let mut rgb = Vec::with_capacity(width * height * 3);
        let mut depth_metres = Vec::with_capacity(width * height);
        let stride = full.width as usize;
        let rows = (full.height as usize).min(factor);
        let pixels = (factor * rows) as u32;
        for row in 0..height {
            for column in 0..width {
                let block = (row * factor..row * factor + rows)
                    .flat_map(|y| (column * factor..(column + 1) * factor).map(move |x| (x, y)))
                    .map(|(x, y)| y * stride + x);
                let mut sum = [0u32; 3];
                for at in block.clone() {
                    for (channel, sum) in sum.iter_mut().enumerate() {
                        *sum += u32::from(frame.rgb[at * 3 + channel]);
                    }
                }
                rgb.extend(sum.map(|sum| ((sum + pixels / 2) / pixels) as u8));
                depth_metres.push(nearest_surface(block.map(|at| frame.depth_metres[at])));
            }
        }
        Self { camera, rgb: rgb.into(), depth_metres: depth_metres.into() }
    }

    /// The columns that [`Working::of`] has.
    pub fn columns(frame: &Frame, columns: u32) -> u32 {
        frame.intrinsics.width / factor(frame, columns) as u32
    }

    /// Whether a world point is on the surface that the picture shows.
    pub fn shows(&self, point: &Point3<f32>) -> bool {
        let Some((u, v, z)) = self.camera.project(point) else { return false };
        let (column, row) = (u.round(), v.round());
        let (width, height) = (self.camera.width as f32, self.camera.height as f32);
        if !(column >= 0.0 && row >= 0.0 && column < width && row < height) {
            return false;
        }
        let measured =
            self.depth_metres[row as usize * self.camera.width as usize + column as usize];
        // Nothing measured is 0 metres: nothing is on that surface.
        (z - measured).abs() <= SAME_POINT * measured
    }

    /// Memory of colors and depths.
    pub fn bytes(&self) -> u64 {
        (self.rgb.len() + size_of_val(&self.depth_metres[..])) as u64
    }

    /// Takes the picture to another pose.
    pub fn place(&mut self, world_from_camera: &Isometry3<f64>) {
        self.camera.camera_from_world = world_from_camera.inverse().cast();
    }
}

/// How many columns become one, at least 1.
fn factor(frame: &Frame, columns: u32) -> usize {
    frame.intrinsics.width.div_ceil(columns.max(1)).max(1) as usize
}

/// The mean of the measurements that are near the nearest one; 0 without any.
fn nearest_surface(depths: impl Iterator<Item = f32> + Clone) -> f32 {
    let measured = depths.filter(|depth| *depth > 0.0);
    let nearest = measured.clone().fold(f32::INFINITY, f32::min);
    let (sum, count) = measured
        .filter(|depth| *depth <= nearest * (1.0 + ONE_SURFACE))
        .fold((0.0, 0u32), |(sum, count), depth| (sum + depth, count + 1));
    if count > 0 { sum / count as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::frame::Intrinsics;
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
            world_from_camera: Some(Isometry3::identity()),
            hint: None,
            labels: None,
            held_out: false,
        }
    }

    #[test]
    fn shrinking_averages_color_and_keeps_the_nearest_surface() {
        let working = Working::of(&frame(8, 4), &Isometry3::identity(), 4);
        assert_eq!((working.camera.width, working.camera.height), (4, 2));
        assert_eq!(working.rgb[..3], [1, 100, 200], "columns 0 and 1: 0.5, rounded up");
        assert_eq!(working.depth_metres[0], 1.0, "the nearest, not the mean of 0, 1, 3 and 3");
        assert_eq!(working.depth_metres[1], 3.0);
        let surface = nearest_surface([2.0, 2.02, 0.0, 2.5].into_iter());
        assert!((surface - 2.01).abs() < 1e-6, "the mean of what lies on one surface: {surface}");
    }

    #[test]
    fn shrinking_keeps_points_where_they_are() {
        let full = frame(8, 4).intrinsics.camera(&Isometry3::identity());
        let small = Working::of(&frame(8, 4), &Isometry3::identity(), 4).camera;
        // The middle of the four top-left pixels is the middle of the small image's first pixel.
        let seen = full.unproject(0.5, 0.5, 2.0);
        let (u, v, _) = small.project(&seen).expect("it is in front of the camera");
        assert!(u.abs() < 1e-5 && v.abs() < 1e-5, "({u}, {v}) should be (0, 0)");
        let (wrong, _, _) = small.project(&full.unproject(0.0, 0.0, 2.0)).expect("in front");
        assert!(wrong.abs() > 0.1, "and the corner pixel alone is not");
    }

    #[test]
    fn a_picture_shows_its_surface_and_nothing_before_behind_or_beside_it() {
        let working = Working::of(&frame(8, 4), &Isometry3::identity(), 8);
        let at = |u, v, depth| working.shows(&working.camera.unproject(u, v, depth));
        assert!(at(4.0, 2.0, 3.0) && at(4.0, 2.0, 3.1));
        assert!(!at(4.0, 2.0, 2.0) && !at(4.0, 2.0, 4.0), "before and behind");
        assert!(!at(9.0, 2.0, 3.0) && !at(4.0, -1.0, 3.0), "beside");
        assert!(!at(0.0, 0.0, 3.0), "a hole");
        assert!(!working.shows(&Point3::new(0.0, 0.0, -3.0)), "behind the camera");
    }

    #[test]
    fn small_frames_stay_as_they_are() {
        let working = Working::of(&frame(8, 4), &Isometry3::identity(), 8);
        assert_eq!((working.camera.width, working.camera.height), (8, 4));
        assert_eq!(working.depth_metres[0], 0.0);
    }
}
