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
use super::intrinsics::Intrinsics;
use glam::{Mat4, Vec4, Vec4Swizzles};
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Neighbours lie on one surface if it is seen at a slant of at most this tangent (83 degrees).
const STEEPEST: f64 = 8.0;
/// Inverse depth from which on nothing is drawn: what is nearer than 0.01 m to the other camera.
const NEAREST: f32 = 100.0;
/// The corners of a pixel, clockwise from the upper left: (right, down).
const CORNERS: [(usize, usize); 4] = [(0, 0), (1, 0), (1, 1), (0, 1)];

/// The pixels of a depth camera, ready to be drawn into another camera's picture.
///
/// Points are (column, row, 1, inverse depth) of the other picture, homogeneous. A point that the depth
/// camera measured along a ray with inverse depth i is `ray + i * origin`.
pub(super) struct DepthRays {
    width: usize,
    height: usize,
    /// Columns and rows of the other picture.
    drawn: [usize; 2],
    /// `[(height + 1) * (width + 1)]`: the rays through the corners of pixels. NaN where the lens has none.
    corners: Vec<Vec4>,
    /// The depth camera itself.
    origin: Vec4,
    /// Neighbours whose depths differ by a larger share lie on different surfaces.
    tear: f32,
}

impl DepthRays {
    /// `other_from_depth`: the pose of the depth camera in the coordinates of the other one.
    pub fn new(camera: &Camera, other_from_depth: &Isometry3<f64>, other: &Intrinsics) -> Self {
        let Intrinsics { width, height, fx, fy, .. } = camera.intrinsics;
        let (width, height) = (width as usize, height as usize);
        let optics = Optics::new(camera);
        let point = |to: Vector3<f64>, inverse: f32| {
            let [column, row] =
                [other.fx * to.x + other.cx * to.z, other.fy * to.y + other.cy * to.z];
            Vec4::new(column as f32, row as f32, to.z as f32, inverse)
        };
        let corner = |index: usize| {
            let (column, row) = (index % (width + 1), index / (width + 1));
            let ray = optics.ray([column as f64 - 0.5, row as f64 - 0.5]);
            let turned = ray.map(|[x, y]| other_from_depth.rotation * Vector3::new(x, y, 1.0));
            turned.map_or(Vec4::NAN, |to| point(to, 0.0))
        };
        Self {
            width,
            height,
            drawn: [other.width as usize, other.height as usize],
            corners: (0..(width + 1) * (height + 1)).into_par_iter().map(corner).collect(),
            origin: point(other_from_depth.translation.vector, 1.0),
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
            let inverses = &measured[row * self.width..][..self.width];
            let pairs = upper.windows(2).zip(lower.windows(2));
            for ((column, own), (above, below)) in inverses.iter().enumerate().zip(pairs) {
                if let (true, &[a, b], &[d, c]) = (*own > 0.0, above, below) {
                    self.draw_pixel(measured, (column, row), [a, b, c, d], &mut canvas);
                }
            }
            upper = lower;
        }
        canvas.inverse
    }

    /// The upper corners of a row's pixels, where the four pixels around them lie on one surface and share
    /// them; NaN where they do not.
    fn joints(&self, measured: &[f32], row: usize) -> Vec<Vec4> {
        let line = |row: usize| &measured[row * self.width..][..self.width];
        // Pixels outside are like their neighbours inside.
        let (above, below) = (line(row.saturating_sub(1)), line(row.min(self.height - 1)));
        let joint = |(column, ray): (usize, &Vec4)| {
            let (left, right) = (column.saturating_sub(1), column.min(self.width - 1));
            let around = Vec4::new(above[left], above[right], below[left], below[right]);
            let (least, most) = (around.min_element(), around.max_element());
            let is_joint = least > 0.0
                && (self.are_together(least, most) || self.is_slanted(measured, [column, row]));
            if is_joint { self.point(*ray, 0.25 * around.element_sum()) } else { Vec4::NAN }
        };
        self.corners[row * (self.width + 1)..][..=self.width]
            .iter()
            .enumerate()
            .map(joint)
            .collect()
    }

    #[inline]
    fn draw_pixel(
        &self,
        measured: &[f32],
        (column, row): (usize, usize),
        joints: [Vec4; 4],
        canvas: &mut Canvas,
    ) {
        let own = measured[row * self.width + column];
        let rays = CORNERS
            .map(|(right, down)| self.corners[(row + down) * (self.width + 1) + column + right]);
        let [a, b, c, d] = rays;
        let mut around = joints;
        if (joints[0] + joints[1] + joints[2] + joints[3]).is_nan() {
            for at in 0..4 {
                if joints[at].is_nan() {
                    let inverse = self.corner_inverse(measured, (column, row), CORNERS[at], own);
                    around[at] = self.point(rays[at], inverse);
                }
            }
        }
        // The measurement itself is kept: without it, edges would be rounded off.
        let middle = self.point(0.25 * (a + b + c + d), own);
        canvas.draw(middle, around);
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

    /// Whether the four pixels around a corner lie on one surface that is seen at a steeper slant, such as a
    /// floor from just above it: inverse depth goes on from the pixels before to the pixels behind as on a
    /// plane. At an edge it does not.
    fn is_slanted(&self, measured: &[f32], [column, row]: [usize; 2]) -> bool {
        if column < 2 || row < 2 || column + 1 >= self.width || row + 1 >= self.height {
            return false;
        }
        let at = |column: usize, row: usize| measured[row * self.width + column];
        let is_straight = |[before, one, other, behind]: [f32; 4]| {
            let step = other - one;
            self.are_together(one, other)
                || (before > 0.0
                    && behind > 0.0
                    && self.are_together(one, before + step)
                    && self.are_together(other, behind - step))
        };
        let rows = [row - 1, row].map(|row| {
            [at(column - 2, row), at(column - 1, row), at(column, row), at(column + 1, row)]
        });
        let columns = [column - 1, column].map(|column| {
            [at(column, row - 2), at(column, row - 1), at(column, row), at(column, row + 1)]
        });
        rows.into_iter().chain(columns).all(is_straight)
    }

    /// Whether two measurements lie on one surface.
    #[inline]
    fn are_together(&self, one: f32, other: f32) -> bool {
        (one - other).abs() <= self.tear * one.min(other)
    }

    /// What was measured along a ray.
    #[inline]
    fn point(&self, ray: Vec4, inverse: f32) -> Vec4 {
        let point = ray + inverse * self.origin;
        point / point.z
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
    #[inline]
    fn draw(&mut self, middle: Vec4, around: [Vec4; 4]) {
        let [a, b, c, d] = around;
        let around = Mat4::from_cols(a, b, c, d).transpose();
        let is_in_front =
            around.w_axis.cmpgt(Vec4::ZERO) & around.w_axis.cmplt(Vec4::splat(NEAREST));
        if !(is_in_front.all() && middle.w > 0.0 && middle.w < NEAREST) {
            return;
        }
        let (columns, rows) =
            (covered(around.x_axis, self.columns), covered(around.y_axis, self.rows));
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let fan = Fan::new(&around, middle);
        for row in rows {
            let line = &mut self.inverse[row * self.columns..][..self.columns];
            for column in columns.clone() {
                let found = fan.at(column as f32, row as f32);
                if found > line[column] {
                    line[column] = found;
                }
            }
        }
    }
}

/// The pixels of a side of the picture between the first and the last of four places.
#[inline]
fn covered(places: Vec4, side: usize) -> Range<usize> {
    // `as` rounds down, and what is below 0 to 0.
    let (least, end) = (places.min_element(), (places.max_element() + 1.0) as usize);
    let first = least as usize;
    first + usize::from((first as f32) < least)..end.min(side)
}

/// The four triangles between a point and those around it.
struct Fan {
    middle: Vec4,
    /// Columns, rows and inverse depths of the triangles' first corners, seen from the middle.
    first: [Vec4; 3],
    /// Those of their second corners.
    second: [Vec4; 3],
    /// 1 / twice their areas; negative where the orientation is.
    scale: Vec4,
}

impl Fan {
    /// `around`: the columns, rows and inverse depths of the points are its axes x, y and w.
    #[inline]
    fn new(around: &Mat4, middle: Vec4) -> Self {
        let first = [around.x_axis - middle.x, around.y_axis - middle.y, around.w_axis - middle.w];
        let second = first.map(|along| along.yzwx());
        let scale = (first[0] * second[1] - second[0] * first[1]).recip();
        Self { middle, first, second, scale }
    }

    /// The largest inverse depth of the triangles at a pixel; minus infinity outside of all.
    #[inline]
    fn at(&self, column: f32, row: f32) -> f32 {
        // Pixels on an edge are inside in spite of rounding.
        const SLACK: f32 = 1e-4;
        let (x, y) = (column - self.middle.x, row - self.middle.y);
        let of_second = (self.first[0] * y - self.first[1] * x) * self.scale;
        let of_first = (self.second[1] * x - self.second[0] * y) * self.scale;
        let is_inside = of_first.min(of_second).cmpge(Vec4::splat(-SLACK))
            & (of_first + of_second).cmple(Vec4::splat(1.0 + SLACK));
        let beyond = of_first * self.first[2] + of_second * self.second[2];
        self.middle.w + Vec4::select(is_inside, beyond, Vec4::NEG_INFINITY).max_element()
    }
}
