//! Registers depth: what a depth camera measured, as another camera sees it.
//!
//! Each pixel of depth is a small quadrilateral, its four corners half a pixel around its centre.
//! Neighbours on one surface share the depth of the corners between them; at the edge of a surface they do
//! not. The quadrilaterals are drawn into the other camera's picture; the nearest one wins. So a surface is
//! closed at any resolution, an edge is as sharp as it was measured, and what is hidden stays hidden. A
//! pixel that no quadrilateral covers has no depth.

use super::camera::{Camera, Optics};
use crate::pipeline::frame::Intrinsics;
use nalgebra::Isometry3;
use rayon::prelude::*;

/// Neighbours lie on one surface if it is seen at a slant of at most this tangent (83 degrees).
const STEEPEST: f64 = 8.0;
/// Nothing nearer to the other camera is drawn, metres.
const NEAREST: f32 = 0.01;

/// The rays of a depth camera, in the coordinates of the camera that depth is registered to.
pub(super) struct DepthRays {
    width: usize,
    height: usize,
    /// `[(height + 1) * (width + 1)]`: directions through the corners of the pixels, for a depth of 1. NaN
    /// where the lens has none.
    corners: Vec<[f32; 3]>,
    /// The depth camera's position, metres.
    origin: [f32; 3],
    /// Neighbours whose depths differ by a larger share lie on different surfaces.
    tear: f32,
}

/// A corner of a pixel, drawn: column, row, and 1 / depth.
type Vertex = [f32; 3];

impl DepthRays {
    /// `other_from_depth`: the pose of the depth camera in the coordinates of the other one.
    pub fn new(camera: &Camera, other_from_depth: &Isometry3<f64>) -> Self {
        let Intrinsics { width, height, fx, fy, .. } = camera.intrinsics;
        let (width, height) = (width as usize, height as usize);
        let optics = Optics::new(camera);
        let corner = |index: usize| {
            let (column, row) = (index % (width + 1), index / (width + 1));
            let ray = optics.ray([column as f64 - 0.5, row as f64 - 0.5]);
            let turned =
                ray.map(|[x, y]| other_from_depth.rotation * nalgebra::Vector3::new(x, y, 1.0));
            turned.map_or([f32::NAN; 3], |along| along.cast::<f32>().into())
        };
        Self {
            width,
            height,
            corners: (0..(width + 1) * (height + 1)).into_par_iter().map(corner).collect(),
            origin: other_from_depth.translation.vector.cast::<f32>().into(),
            tear: (STEEPEST / fx.min(fy)) as f32,
        }
    }

    /// Depth as `other` sees it: `[height * width]` of that camera, metres; 0 where nothing is known.
    pub fn registered(&self, depth_metres: &[f32], other: &Intrinsics) -> Vec<f32> {
        let bands = rayon::current_num_threads().clamp(1, 16);
        let rows = self.height.div_ceil(bands).max(1);
        let pixels = other.width as usize * other.height as usize;
        let inverse = (0..self.height.div_ceil(rows))
            .into_par_iter()
            .map(|band| {
                let mut canvas = Canvas::new(other, pixels);
                for row in band * rows..((band + 1) * rows).min(self.height) {
                    self.draw_row(depth_metres, row, &mut canvas);
                }
                canvas.inverse
            })
            // The largest of floats does not depend on their order.
            .reduce_with(|mut one, another| {
                one.iter_mut().zip(another).for_each(|(a, b)| *a = a.max(b));
                one
            });
        let metres = |inverse: f32| if inverse > 0.0 { inverse.recip() } else { 0.0 };
        inverse.unwrap_or_default().into_iter().map(metres).collect()
    }

    fn draw_row(&self, depths: &[f32], row: usize, canvas: &mut Canvas) {
        for column in 0..self.width {
            let depth = depths[row * self.width + column];
            if depth <= 0.0 {
                continue;
            }
            // Clockwise from the upper left.
            let around = [(0, 0), (1, 0), (1, 1), (0, 1)];
            let vertices = around.map(|(right, down)| {
                let near = self.corner_depth(depths, (column, row), (right, down), depth);
                let [x, y, z] = self.corners[(row + down) * (self.width + 1) + column + right];
                let [a, b, c] = self.origin;
                canvas.vertex([x * near + a, y * near + b, z * near + c])
            });
            if let [Some(a), Some(b), Some(c), Some(d)] = vertices {
                // The measurement itself is kept: without it, the four triangles around it would round off
                // edges.
                let Some(own) = self.centre(column, row, depth, canvas) else { continue };
                canvas.triangle([own, a, b]);
                canvas.triangle([own, b, c]);
                canvas.triangle([own, c, d]);
                canvas.triangle([own, d, a]);
            }
        }
    }

    /// The middle of a pixel, drawn.
    fn centre(&self, column: usize, row: usize, depth: f32, canvas: &Canvas) -> Option<Vertex> {
        let [upper, lower] = [row, row + 1].map(|row| row * (self.width + 1) + column);
        let (a, b) = (self.corners[upper], self.corners[upper + 1]);
        let (c, d) = (self.corners[lower], self.corners[lower + 1]);
        let along = |axis: usize| {
            0.25 * (a[axis] + b[axis] + c[axis] + d[axis]) * depth + self.origin[axis]
        };
        canvas.vertex([along(0), along(1), along(2)])
    }

    /// Depth at a corner of a pixel: that of the pixels around it which lie on the same surface. Inverse
    /// depth is linear on a plane, so it is averaged.
    fn corner_depth(
        &self,
        depths: &[f32],
        (column, row): (usize, usize),
        (right, down): (usize, usize),
        own: f32,
    ) -> f32 {
        // Wraps below 0 to a large number, which is outside.
        let beside = (column + right).wrapping_sub(1 - right);
        let above = (row + down).wrapping_sub(1 - down);
        let (mut sum, mut count) = (own.recip(), 1.0);
        for (column, row) in [(beside, row), (column, above), (beside, above)] {
            if column >= self.width || row >= self.height {
                continue;
            }
            let depth = depths[row * self.width + column];
            if depth > 0.0 && (depth - own).abs() <= self.tear * own.min(depth) {
                sum += depth.recip();
                count += 1.0;
            }
        }
        count / sum
    }
}

/// The picture that is drawn.
struct Canvas {
    width: f32,
    height: f32,
    columns: usize,
    focal: [f32; 2],
    principal: [f32; 2],
    /// `[height * width]`, 1 / depth; 0 where nothing is drawn.
    inverse: Vec<f32>,
}

impl Canvas {
    fn new(camera: &Intrinsics, pixels: usize) -> Self {
        Self {
            width: camera.width as f32,
            height: camera.height as f32,
            columns: camera.width as usize,
            focal: [camera.fx as f32, camera.fy as f32],
            principal: [camera.cx as f32, camera.cy as f32],
            inverse: vec![0.0; pixels],
        }
    }

    fn vertex(&self, [x, y, z]: [f32; 3]) -> Option<Vertex> {
        // This form of the condition also refuses NaN.
        (z > NEAREST).then(|| {
            let inverse = z.recip();
            let [column, row] = [x * inverse, y * inverse];
            [
                self.focal[0] * column + self.principal[0],
                self.focal[1] * row + self.principal[1],
                inverse,
            ]
        })
    }

    /// Draws a triangle of either orientation; pixels on its edges belong to it.
    fn triangle(&mut self, [a, b, c]: [Vertex; 3]) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area == 0.0 {
            return;
        }
        let least = |axis: usize| a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0);
        let most =
            |axis: usize, side: f32| a[axis].max(b[axis]).max(c[axis]).floor().min(side - 1.0);
        let (left, right) = (least(0), most(0, self.width));
        let (top, bottom) = (least(1), most(1, self.height));
        if left > right || top > bottom {
            return;
        }
        // Pixels on an edge are inside in spite of rounding.
        const SLACK: f32 = -1e-4;
        let scale = area.recip();
        for row in top as usize..=bottom as usize {
            for column in left as usize..=right as usize {
                let (x, y) = (column as f32, row as f32);
                let share = |p: &Vertex, q: &Vertex| {
                    ((q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1])) * scale
                };
                let (of_a, of_b, of_c) = (share(&b, &c), share(&c, &a), share(&a, &b));
                if of_a >= SLACK && of_b >= SLACK && of_c >= SLACK {
                    let inverse = of_a * a[2] + of_b * b[2] + of_c * c[2];
                    let drawn = &mut self.inverse[row * self.columns + column];
                    *drawn = drawn.max(inverse);
                }
            }
        }
    }
}
