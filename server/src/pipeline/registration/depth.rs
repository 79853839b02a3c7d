//! Registers depth: what a depth camera measured, as another camera sees it.
//!
//! Each pixel of depth is a small quadrilateral, its four corners half a pixel around its centre.
//! Neighbours on one surface share the depth of the corners between them; at the edge of a surface they do
//! not. The quadrilaterals are drawn into the other camera's picture; the nearest one wins. So a surface is
//! closed at any resolution, an edge is as sharp as it was measured, and what is hidden stays hidden. A
//! pixel that no quadrilateral covers has no depth.
//!
//! All of it is computed with inverse depth, 1 / metres: on a plane it is linear in the picture.

use super::camera::{Camera, Optics};
use crate::pipeline::frame::Intrinsics;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Neighbours lie on one surface if it is seen at a slant of at most this tangent (83 degrees).
const STEEPEST: f64 = 8.0;
/// Inverse depth from which on nothing is drawn: what is nearer than 0.01 m to the other camera.
const NEAREST: f32 = 100.0;
/// The corners of a pixel, clockwise from the upper left: (right, down).
const CORNERS: [(usize, usize); 4] = [(0, 0), (1, 0), (1, 1), (0, 1)];

/// A point in the other picture: column, row, and inverse depth there.
type Vertex = [f32; 3];
/// A point that is not drawn.
const NOWHERE: Vertex = [f32::NAN; 3];

/// The pixels of a depth camera, ready to be drawn into another camera's picture.
///
/// A ray is a point of the other picture in homogeneous coordinates. What the depth camera measured along
/// it with inverse depth i is at `ray + i * origin`.
pub(super) struct DepthRays {
    width: usize,
    height: usize,
    /// Columns and rows of the other picture.
    drawn: [usize; 2],
    /// `[(height + 1) * (width + 1)]`: the rays through the corners of pixels. NaN where the lens has none.
    corners: Vec<[f32; 3]>,
    /// The depth camera itself.
    origin: [f32; 3],
    /// Neighbours whose depths differ by a larger share lie on different surfaces.
    tear: f32,
}

impl DepthRays {
    /// `other_from_depth`: the pose of the depth camera in the coordinates of the other one.
    pub fn new(camera: &Camera, other_from_depth: &Isometry3<f64>, other: &Intrinsics) -> Self {
        let Intrinsics { width, height, fx, fy, .. } = camera.intrinsics;
        let (width, height) = (width as usize, height as usize);
        let optics = Optics::new(camera);
        let projected = |to: Vector3<f64>| {
            [other.fx * to.x + other.cx * to.z, other.fy * to.y + other.cy * to.z, to.z]
                .map(|along| along as f32)
        };
        let corner = |index: usize| {
            let (column, row) = (index % (width + 1), index / (width + 1));
            let ray = optics.ray([column as f64 - 0.5, row as f64 - 0.5]);
            let turned = ray.map(|[x, y]| other_from_depth.rotation * Vector3::new(x, y, 1.0));
            turned.map_or(NOWHERE, projected)
        };
        Self {
            width,
            height,
            drawn: [other.width as usize, other.height as usize],
            corners: (0..(width + 1) * (height + 1)).into_par_iter().map(corner).collect(),
            origin: projected(other_from_depth.translation.vector),
            tear: (STEEPEST / fx.min(fy)) as f32,
        }
    }

    /// Depth as the other camera sees it: `[height * width]` of its picture, metres; 0 where nothing is
    /// known.
    pub fn registered(&self, depth_metres: &[f32]) -> Vec<f32> {
        let inverse = |depth: &f32| if *depth > 0.0 { depth.recip() } else { 0.0 };
        let measured: Vec<f32> = depth_metres.iter().map(inverse).collect();
        let bands = rayon::current_num_threads().clamp(1, 16);
        let rows = self.height.div_ceil(bands).max(1);
        let drawn = (0..self.height.div_ceil(rows))
            .into_par_iter()
            .map(|band| self.drawn(&measured, band * rows..((band + 1) * rows).min(self.height)))
            // The largest of floats does not depend on their order.
            .reduce_with(|mut one, another| {
                one.iter_mut().zip(another).for_each(|(a, b)| *a = a.max(b));
                one
            });
        drawn.unwrap_or_default().iter().map(inverse).collect()
    }

    /// Draws some rows of pixels: `[height * width]` of the other picture, inverse depth; 0 where nothing is.
    fn drawn(&self, measured: &[f32], rows: Range<usize>) -> Vec<f32> {
        let mut canvas = Canvas::new(self.drawn);
        let mut upper = self.joints(measured, rows.start);
        for row in rows {
            let lower = self.joints(measured, row + 1);
            for column in 0..self.width {
                if measured[row * self.width + column] > 0.0 {
                    let joints =
                        [upper[column], upper[column + 1], lower[column + 1], lower[column]];
                    self.draw_pixel(measured, [column, row], joints, &mut canvas);
                }
            }
            upper = lower;
        }
        canvas.inverse
    }

    /// The upper corners of a row's pixels, where the four pixels around them lie on one surface and share
    /// them; [`NOWHERE`] where they do not.
    fn joints(&self, measured: &[f32], row: usize) -> Vec<Vertex> {
        let line = |row: usize| &measured[row * self.width..][..self.width];
        // Pixels outside are like their neighbours inside.
        let (above, below) = (line(row.saturating_sub(1)), line(row.min(self.height - 1)));
        let joint = |(column, corner): (usize, &[f32; 3])| {
            let (left, right) = (column.saturating_sub(1), column.min(self.width - 1));
            let around = [above[left], above[right], below[left], below[right]];
            let (least, most) = (least(around), most(around));
            if least > 0.0 && self.are_together(least, most) {
                self.vertex(*corner, 0.25 * around.iter().sum::<f32>())
            } else {
                NOWHERE
            }
        };
        self.corners[row * (self.width + 1)..][..=self.width]
            .iter()
            .enumerate()
            .map(joint)
            .collect()
    }

    fn draw_pixel(
        &self,
        measured: &[f32],
        [column, row]: [usize; 2],
        mut around: [Vertex; 4],
        canvas: &mut Canvas,
    ) {
        let own = measured[row * self.width + column];
        let rays = CORNERS
            .map(|(right, down)| self.corners[(row + down) * (self.width + 1) + column + right]);
        for (at, vertex) in around.iter_mut().enumerate() {
            if vertex[2].is_nan() {
                let inverse = self.corner_inverse(measured, (column, row), CORNERS[at], own);
                *vertex = self.vertex(rays[at], inverse);
            }
        }
        // The measurement itself is kept: without it, edges would be rounded off.
        let [a, b, c, d] = rays;
        let middle = [0, 1, 2].map(|axis| 0.25 * (a[axis] + b[axis] + c[axis] + d[axis]));
        canvas.draw(self.vertex(middle, own), around);
    }

    /// Inverse depth at a corner of a pixel: the mean of the pixels around it that lie on the same surface.
    fn corner_inverse(
        &self,
        measured: &[f32],
        (column, row): (usize, usize),
        (right, down): (usize, usize),
        own: f32,
    ) -> f32 {
        // Wraps below 0 to a large number, which is outside.
        let beside = (column + right).wrapping_sub(1 - right);
        let above = (row + down).wrapping_sub(1 - down);
        let (mut sum, mut count) = (own, 1.0);
        for (column, row) in [(beside, row), (column, above), (beside, above)] {
            if column >= self.width || row >= self.height {
                continue;
            }
            let inverse = measured[row * self.width + column];
            if inverse > 0.0 && self.are_together(inverse, own) {
                sum += inverse;
                count += 1.0;
            }
        }
        sum / count
    }

    /// Whether two measurements lie on one surface.
    fn are_together(&self, one: f32, other: f32) -> bool {
        (one - other).abs() <= self.tear * one.min(other)
    }

    fn vertex(&self, ray: [f32; 3], inverse: f32) -> Vertex {
        let along = |axis: usize| ray[axis] + inverse * self.origin[axis];
        let scale = along(2).recip();
        [along(0) * scale, along(1) * scale, inverse * scale]
    }
}

/// The picture that is drawn.
struct Canvas {
    columns: usize,
    rows: usize,
    /// `[rows * columns]`, inverse depth; 0 where nothing is drawn.
    inverse: Vec<f32>,
}

impl Canvas {
    fn new([columns, rows]: [usize; 2]) -> Self {
        Self { columns, rows, inverse: vec![0.0; columns * rows] }
    }

    /// Draws the four triangles between a point and those around it. Pixels on an edge belong to both sides.
    fn draw(&mut self, middle: Vertex, around: [Vertex; 4]) {
        // This form of the condition also refuses NaN.
        let is_in_front = |vertex: &Vertex| vertex[2] > 0.0 && vertex[2] < NEAREST;
        if !(is_in_front(&middle) && around.iter().all(is_in_front)) {
            return;
        }
        let covered = |axis: usize, side: usize| {
            let along = around.map(|vertex| vertex[axis]);
            // `as` rounds down, and below 0 to 0.
            let first = least(along) as usize;
            let is_before = (first as f32) < least(along);
            first + usize::from(is_before)..((most(along) + 1.0) as usize).min(side)
        };
        let (columns, rows) = (covered(0, self.columns), covered(1, self.rows));
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let away = around.map(|vertex| [0, 1, 2].map(|axis| vertex[axis] - middle[axis]));
        let triangles = [0, 1, 2, 3].map(|at| Triangle::new(away[at], away[(at + 1) % 4]));
        for row in rows {
            let y = row as f32 - middle[1];
            let line = &mut self.inverse[row * self.columns..][..self.columns];
            for column in columns.clone() {
                let x = column as f32 - middle[0];
                for beyond in triangles.iter().filter_map(|triangle| triangle.at(x, y)) {
                    line[column] = line[column].max(middle[2] + beyond);
                }
            }
        }
    }
}

/// A triangle with one corner at the origin.
struct Triangle {
    one: Vertex,
    next: Vertex,
    /// Twice its area, pixels squared.
    area: f32,
}

impl Triangle {
    fn new(one: Vertex, next: Vertex) -> Self {
        let area = one[0] * next[1] - next[0] * one[1];
        // Both orientations are drawn.
        if area < 0.0 {
            Self { one: next, next: one, area: -area }
        } else {
            Self { one, next, area }
        }
    }

    /// The third coordinate at a place; `None` outside.
    fn at(&self, x: f32, y: f32) -> Option<f32> {
        // Pixels on an edge are inside in spite of rounding.
        const SLACK: f32 = 1e-4;
        let slack = SLACK * self.area;
        let of_next = self.one[0] * y - x * self.one[1];
        let of_one = x * self.next[1] - self.next[0] * y;
        let is_inside = self.area > 0.0
            && of_next >= -slack
            && of_one >= -slack
            && of_next + of_one <= self.area + slack;
        is_inside.then(|| (of_one * self.one[2] + of_next * self.next[2]) / self.area)
    }
}

fn least([a, b, c, d]: [f32; 4]) -> f32 {
    a.min(b).min(c.min(d))
}

fn most([a, b, c, d]: [f32; 4]) -> f32 {
    a.max(b).max(c.max(d))
}
