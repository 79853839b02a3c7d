//! Removes the distortion of a lens from color and labels.

use super::camera::{Camera, Optics};
use crate::pipeline::frame::Intrinsics;
use rayon::prelude::*;

/// Half the field of view of a rectified picture along an axis at most, as the tangent: 60 degrees. Towards
/// the edge of a wider one a few pixels of the fisheye would fill half of the picture.
const WIDEST: f64 = 1.732;
/// Halvings when an edge is searched.
const HALVINGS: usize = 40;
/// Points of each edge of the picture that are tried.
const EDGE_POINTS: u32 = 64;

/// The pinhole camera of the same size with the widest field of view in which the lens saw every pixel.
/// `None` if the lens does not see along its axis: then the numbers are wrong.
pub(super) fn pinhole(camera: &Camera) -> Option<Intrinsics> {
    let optics = Optics::new(camera);
    if !optics.sees([0.0, 0.0]) {
        return None;
    }
    let edge =
        |direction: [f64; 2]| widest(WIDEST, |far| optics.sees(direction.map(|along| along * far)));
    let [left, right] = [edge([-1.0, 0.0]), edge([1.0, 0.0])];
    let [top, bottom] = [edge([0.0, -1.0]), edge([0.0, 1.0])];
    // The corners of a lens that draws them outwards were outside its picture.
    let is_seen = |scale: f64| {
        (0..=EDGE_POINTS).map(|point| f64::from(point) / f64::from(EDGE_POINTS)).all(|share| {
            let (x, y) = (share * (left + right) - left, share * (top + bottom) - top);
            [[x, -top], [x, bottom], [-left, y], [right, y]]
                .iter()
                .all(|ray| optics.sees(ray.map(|along| along * scale)))
        })
    };
    let scale = widest(1.0, is_seen);
    let Intrinsics { width, height, .. } = camera.intrinsics;
    let focal = |side: u32, from: f64, to: f64| {
        f64::from(side.max(2) - 1) / (scale * (from + to)).max(1e-9)
    };
    let (fx, fy) = (focal(width, left, right), focal(height, top, bottom));
    Some(Intrinsics { width, height, fx, fy, cx: scale * left * fx, cy: scale * top * fy })
}

/// The largest number up to `most` for which `holds`; it must hold for all smaller ones.
fn widest(most: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(most) {
        return most;
    }
    let (mut low, mut high) = (0.0, most);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

/// Weights of the pixels before, at, after and beyond a place (Catmull–Rom); `along`: from the second to
/// the third, 0 to 1.
fn cubic(along: f32) -> [f32; 4] {
    let (one, two, three) = (along, along * along, along * along * along);
    [
        -0.5 * one + two - 0.5 * three,
        1.0 - 2.5 * two + 1.5 * three,
        0.5 * one + 2.0 * two - 1.5 * three,
        -0.5 * two + 0.5 * three,
    ]
}

/// Where the pixels of a pinhole camera are in the distorted picture.
pub(super) struct Rectification {
    width: usize,
    height: usize,
    /// `[height * width]`, (column, row) in the distorted picture.
    places: Vec<[f32; 2]>,
}

impl Rectification {
    /// `to` is a pinhole camera of the same size as `from`.
    pub fn new(from: &Camera, to: &Intrinsics) -> Self {
        let (width, height) = (to.width as usize, to.height as usize);
        let optics = Optics::new(from);
        let place = |pixel: usize| {
            let (column, row) = ((pixel % width) as f64, (pixel / width) as f64);
            let ray = [(column - to.cx) / to.fx, (row - to.cy) / to.fy];
            // The camera was chosen so that every pixel is seen, up to rounding.
            let [column, row] = optics.pixel(ray).unwrap_or_default();
            let inside = |at: f64, side: usize| at.clamp(0.0, (side - 1) as f64) as f32;
            [inside(column, width), inside(row, height)]
        };
        Self { width, height, places: (0..width * height).into_par_iter().map(place).collect() }
    }

    /// The picture of the pinhole camera, `[height * width * 3]`, by cubic interpolation: bilinear
    /// interpolation takes away a third of the gradients.
    pub fn color(&self, rgb: &[u8]) -> Vec<u8> {
        let (width, height) = (self.width, self.height);
        let mut rectified = vec![0; rgb.len()];
        let rows = rectified.par_chunks_mut(3 * width).zip(self.places.par_chunks(width));
        rows.for_each(|(pixels, places)| {
            for (pixel, [column, row]) in pixels.chunks_exact_mut(3).zip(places) {
                let (left, top) = (*column as usize, *row as usize);
                let (across, down) = (cubic(column - left as f32), cubic(row - top as f32));
                // The outermost pixels go on outside.
                let columns = [0, 1, 2, 3].map(|tap| (left + tap).saturating_sub(1).min(width - 1));
                let mut sum = [0.0; 3];
                for (tap, weight) in down.into_iter().enumerate() {
                    let row = &rgb[3 * width * (top + tap).saturating_sub(1).min(height - 1)..];
                    for (column, share) in columns.into_iter().zip(across) {
                        let weight = weight * share;
                        for (sum, value) in sum.iter_mut().zip(&row[3 * column..]) {
                            *sum += weight * f32::from(*value);
                        }
                    }
                }
                for (value, sum) in pixel.iter_mut().zip(sum) {
                    // Overshoots end at 0 and 255.
                    *value = (sum + 0.5) as u8;
                }
            }
        });
        rectified
    }

    /// The labels of the pinhole camera's pixels, `[height * width]`: the nearest.
    pub fn labels(&self, ids: &[u16]) -> Vec<u16> {
        let nearest = |[column, row]: &[f32; 2]| {
            ids[(row + 0.5) as usize * self.width + (column + 0.5) as usize]
        };
        self.places.iter().map(nearest).collect()
    }
}
