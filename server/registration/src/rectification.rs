//! Removes the distortion of a lens from color and labels.

use super::camera::{Camera, Optics};
use super::intrinsics::Intrinsics;
use glam::Vec4;
use rayon::prelude::*;

/// Half the field of view of a rectified picture along an axis at most, as the tangent: 60 degrees. Towards
/// the edge of a wider one a few pixels of the fisheye would fill half of the picture.
const WIDEST: f64 = 1.732;
/// Most by which straightening may enlarge a picture.
const MOST_STRETCHED: f64 = 4.0;
/// Halvings when an edge is searched.
const HALVINGS: usize = 40;
/// Points of each edge of the picture that are tried.
const EDGE_POINTS: u32 = 64;
/// Slope of the interpolation's kernel at a distance of one pixel, as OpenCV has it. Of the squared
/// gradients it takes away a fourteenth, -0.5 an eighth, and bilinear interpolation a third.
const STEEPNESS: f32 = -0.75;
/// Columns and rows by which cubic interpolation reaches beyond a picture.
const PADDING: usize = 3;

/// A lens that cannot be straightened: its numbers must be wrong.
#[derive(Debug, thiserror::Error)]
pub enum LensError {
    /// It does not see along its axis.
    #[error(
        "expected a lens that sees along its axis: are the principal point and the coefficients right, and in \
         OpenCV's order (k1 k2 p1 p2 k3 k4 k5 k6)?"
    )]
    Blind,
    /// Rays of its picture cross.
    #[error(
        "expected a lens that sees each thing once: are the coefficients right, and in OpenCV's order (k1 k2 p1 p2 \
         k3 k4 k5 k6)?"
    )]
    Folded,
    /// So little of its field is straight that a picture of it would be enlarged this many times.
    #[error(
        "expected a lens whose straightened picture is at most {MOST_STRETCHED} times as large, found {0:.1}: are \
         the coefficients right, and of this model?"
    )]
    Stretched(f64),
}

/// The pinhole camera of the same size with the widest field of view in which the lens saw every pixel: the
/// camera itself if its lens is straight.
///
/// # Errors
/// [`LensError`] if the numbers of the lens must be wrong.
pub fn pinhole(camera: &Camera) -> Result<Intrinsics, LensError> {
    if camera.distortion.is_none() {
        return Ok(camera.intrinsics);
    }
    let optics = Optics::new(camera);
    if !optics.sees([0.0, 0.0]) {
        return Err(LensError::Blind);
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
    let stretch = (fx / camera.intrinsics.fx).max(fy / camera.intrinsics.fy);
    if stretch.is_nan() || stretch > MOST_STRETCHED {
        return Err(LensError::Stretched(stretch));
    }
    let straight =
        Intrinsics { width, height, fx, fy, cx: scale * left * fx, cy: scale * top * fy };
    if folds(&optics, &straight) {
        return Err(LensError::Folded);
    }
    Ok(straight)
}

/// Whether the lens is not one-to-one somewhere in the picture of the pinhole camera.
fn folds(optics: &Optics, seen: &Intrinsics) -> bool {
    let along =
        |side: u32, at: u32| f64::from(side.max(1) - 1) * f64::from(at) / f64::from(EDGE_POINTS);
    let is_folded =
        |x: f64, y: f64| !optics.is_one_to_one([(x - seen.cx) / seen.fx, (y - seen.cy) / seen.fy]);
    (0..=EDGE_POINTS).any(|column| {
        (0..=EDGE_POINTS).any(|row| is_folded(along(seen.width, column), along(seen.height, row)))
    })
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

/// Weights of the pixels before, at, after and beyond a place (Keys 1981, equation 4); `along`: from the
/// second to the third, 0 to 1.
#[inline]
fn cubic(along: f32) -> [f32; 4] {
    let inner = |d: f32| ((STEEPNESS + 2.0) * d - (STEEPNESS + 3.0)) * d * d + 1.0;
    let outer = |d: f32| STEEPNESS * (((d - 5.0) * d + 8.0) * d - 4.0);
    [outer(1.0 + along), inner(along), inner(1.0 - along), outer(2.0 - along)]
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

    /// The picture of the pinhole camera, `[height * width * 3]`, by cubic interpolation.
    pub fn color(&self, rgb: &[u8]) -> Vec<u8> {
        let padded = self.padded(rgb);
        let mut rectified = vec![0; rgb.len()];
        let rows = rectified.par_chunks_mut(3 * self.width).zip(self.places.par_chunks(self.width));
        rows.for_each(|(pixels, places)| {
            for (pixel, [column, row]) in pixels.chunks_exact_mut(3).zip(places) {
                let (left, top) = (*column as usize, *row as usize);
                let (across, down) = (cubic(column - left as f32), cubic(row - top as f32));
                // For rounding.
                let mut sum = Vec4::splat(0.5);
                for (tap, share) in down.into_iter().enumerate() {
                    let line = &padded[(top + tap) * (self.width + PADDING) + left..];
                    let Some([a, b, c, d]) = line.first_chunk() else { continue };
                    sum += share * (across[0] * a + across[1] * b + across[2] * c + across[3] * d);
                }
                // Overshoots end at 0 and 255.
                pixel.copy_from_slice(&[sum[0] as u8, sum[1] as u8, sum[2] as u8]);
            }
        });
        rectified
    }

    /// The picture with its outermost pixels repeated, once before and twice behind, so that each place has
    /// all its neighbours: `[(height + 3) * (width + 3)]`, red, green, blue and 0. Four numbers are computed
    /// as fast as one.
    fn padded(&self, rgb: &[u8]) -> Vec<Vec4> {
        let (width, height) = (self.width, self.height);
        let mut padded = vec![Vec4::ZERO; (width + PADDING) * (height + PADDING)];
        padded.par_chunks_mut(width + PADDING).enumerate().for_each(|(row, pixels)| {
            let line = &rgb[3 * width * row.saturating_sub(1).min(height - 1)..][..3 * width];
            for (pixel, values) in pixels[1..].iter_mut().zip(line.chunks_exact(3)) {
                *pixel = Vec4::new(values[0].into(), values[1].into(), values[2].into(), 0.0);
            }
            pixels[0] = pixels[1];
            let last = pixels[width];
            pixels[width + 1..].fill(last);
        });
        padded
    }

    /// The labels of the pinhole camera's pixels, `[height * width]`: the nearest.
    pub fn labels(&self, ids: &[u16]) -> Vec<u16> {
        let nearest = |[column, row]: &[f32; 2]| {
            ids[(row + 0.5) as usize * self.width + (column + 0.5) as usize]
        };
        self.places.iter().map(nearest).collect()
    }
}
