//! A keyframe's picture at the size at which it was received, in windows as large as its training image.
//!
//! A step on a window costs as much time and memory as one on the training image, whatever the camera's size.
//! Pictures and targets of windows are made when they are needed and not kept.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::{Frame, Intrinsics};
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use lexsplat_gpu::Camera;
use std::ops::Range;
use std::sync::Arc;

/// Depth of a whole picture, `[height * width]`, metres; 0 where nothing was measured. Half precision changes
/// a depth by less than 0.0005 of it.
#[derive(Clone)]
pub(super) struct FullDepth(pub Arc<[f16]>);

impl FullDepth {
    pub fn new(frame: &Frame) -> Self {
        let mut depth = vec![f16::ZERO; frame.depth_metres.len()];
        depth.convert_from_f32_slice(&frame.depth_metres);
        Self(depth.into())
    }

    pub fn bytes(&self) -> u64 {
        size_of_val(&self.0[..]) as u64
    }
}

/// How a picture is cut into windows.
pub(super) struct Grid {
    columns: usize,
    rows: usize,
}

impl Grid {
    /// Cuts a picture of this camera into windows as large as `training`.
    pub fn new(intrinsics: &Intrinsics, training: &Camera) -> Self {
        let times = |full: u32, part: u32| (full / part.max(1)).max(1) as usize;
        Self {
            columns: times(intrinsics.width, training.width),
            rows: times(intrinsics.height, training.height),
        }
    }

    /// Number of windows.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// The window of this index, row by row: its pixels, and its camera made of the whole picture's.
    pub fn window(&self, index: usize, full: &Camera) -> (Range<usize>, Range<usize>, Camera) {
        let part = |at: usize, count: usize, size: u32| {
            at * size as usize / count..(at + 1) * size as usize / count
        };
        let columns = part(index % self.columns, self.columns, full.width);
        let rows = part(index / self.columns, self.rows, full.height);
        let camera = Camera {
            width: columns.len() as u32,
            height: rows.len() as u32,
            cx: full.cx - columns.start as f32,
            cy: full.cy - rows.start as f32,
            ..full.clone()
        };
        (columns, rows, camera)
    }
}

/// A part of a picture, with thin gaps in its depth closed.
pub(super) fn cut(
    rgb: &[u8],
    depth: &FullDepth,
    stride: usize,
    (columns, rows, camera): (Range<usize>, Range<usize>, Camera),
) -> DownsampledFrame {
    let lines = rows.map(|row| row * stride + columns.start..row * stride + columns.end);
    let rgb: Vec<u8> =
        lines.clone().flat_map(|line| &rgb[line.start * 3..line.end * 3]).copied().collect();
    let depth: Vec<f32> =
        lines.flat_map(|line| &depth.0[line]).map(|depth| depth.to_f32()).collect();
    let window = DownsampledFrame { camera, rgb: rgb.into(), depth_metres: depth.into() };
    window.without_gaps()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;

    /// A picture of 9x5 pixels, whose red is the pixel's number and whose depth grows with it.
    fn picture() -> (Camera, Vec<u8>, FullDepth) {
        let camera = Camera {
            width: 9,
            height: 5,
            fx: 6.0,
            fy: 6.0,
            cx: 4.0,
            cy: 2.0,
            camera_from_world: Isometry3::translation(0.0, 0.0, 1.0),
        };
        let rgb = (0..45).flat_map(|at| [at, 0, 0]).collect();
        let depth = (0..45).map(|at| f16::from_f32(1.0 + f32::from(at as u8) / 64.0)).collect();
        (camera, rgb, FullDepth(depth))
    }

    #[test]
    fn windows_cover_the_picture_once_and_show_the_same_points() {
        let (full, rgb, depth) = picture();
        let training = Camera { width: 4, height: 2, ..full.clone() };
        let intrinsics = Intrinsics { width: 9, height: 5, fx: 6.0, fy: 6.0, cx: 4.0, cy: 2.0 };
        let grid = Grid::new(&intrinsics, &training);
        assert_eq!(grid.len(), 4);
        let mut seen = [0; 45];
        for index in 0..grid.len() {
            let window = cut(&rgb, &depth, 9, grid.window(index, &full));
            for (pixel, red) in window.rgb.iter().step_by(3).enumerate() {
                let at = usize::from(*red);
                seen[at] += 1;
                let point = full.unproject((at % 9) as f32, (at / 9) as f32, depth.0[at].to_f32());
                assert!((window.point(pixel).unwrap() - point).norm() < 1e-5, "pixel {at}");
            }
            // Negative control: with the whole picture's camera only the first window is right.
            let wrong = DownsampledFrame {
                camera: Camera { cx: full.cx, cy: full.cy, ..window.camera.clone() },
                ..window.clone()
            };
            let is_right = (wrong.point(0).unwrap() - window.point(0).unwrap()).norm() < 1e-5;
            assert_eq!(is_right, index == 0);
        }
        assert_eq!(seen, [1; 45]);
    }

    #[test]
    fn half_precision_keeps_depths() {
        for depth in [0.0_f32, 0.1234, 3.217, 9.99, 60.0] {
            let kept = f16::from_f32(depth).to_f32();
            assert!((kept - depth).abs() <= 0.0005 * depth, "{depth}: {kept}");
        }
    }
}
