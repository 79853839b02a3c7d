//! Facets: small pieces of measured surface with their normals.

use super::super::downsampled_frame::DownsampledFrame;
use nalgebra::{Isometry3, Matrix3, SymmetricEigen, Vector3};

/// Facets of a picture, at most about so many.
const FACETS: f64 = 400.0;
/// Half the side of the square of surface that a normal is fitted to: so many metres, or that share of its
/// depth, because the noise of depth grows with it. The larger one counts.
const HALF_SIDE_METRES: f32 = 0.1;
const HALF_SIDE_SHARE: f32 = 0.05;
/// Half the side of that square in pixels.
const HALF_SIDE_PIXELS: std::ops::RangeInclusive<f32> = 1.0..=30.0;
/// Points of the square in each direction.
const ACROSS: i64 = 5;
/// Points of the square that must have a depth, of ACROSS².
const LEAST_POINTS: usize = 18;
/// A surface is flat if its points leave the plane by this share of their spread in it.
const FLATNESS: f64 = 0.25;
/// A surface that is seen at a flatter angle than this (its cosine) is left out: its depth is not certain.
const LEAST_COSINE: f64 = 0.1;
/// A farther surface counts as if it were so near: a pixel of it stands for more of it, but its depth is less
/// certain.
const FARTHEST_METRES: f64 = 5.0;

/// A piece of surface, in the coordinates of the camera that measured it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) struct Facet {
    /// Unit normal on the side of the camera.
    pub normal: Vector3<f64>,
    /// Its area, in any unit that is the same for all facets of all cameras.
    pub area: f64,
}

/// What a keyframe says of the direction up.
pub(in super::super) struct View<'a> {
    pub world_from_camera: &'a Isometry3<f64>,
    /// Surfaces that it measured.
    pub facets: &'a [Facet],
}

impl Facet {
    /// Facets on a regular grid of a picture, where the surface is flat.
    pub fn sampled(image: &DownsampledFrame) -> Vec<Self> {
        let (width, height) = (image.camera.width as usize, image.camera.height as usize);
        let stride = ((width * height) as f64 / FACETS).sqrt().ceil().max(1.0) as usize;
        let grid = |size| (stride / 2..size).step_by(stride);
        let places = grid(height).flat_map(|row| grid(width).map(move |column| [column, row]));
        let pixels = (stride * stride) as f64;
        places.filter_map(|place| Self::at(image, place, pixels)).collect()
    }

    /// The facet around a pixel, which stands for so many `pixels`.
    fn at(image: &DownsampledFrame, place: [usize; 2], pixels: f64) -> Option<Self> {
        let camera = &image.camera;
        let middle = point(image, place.map(|at| at as i64))?;
        let half = (HALF_SIDE_METRES / middle.z as f32).max(HALF_SIDE_SHARE) * camera.fx;
        let half = half.clamp(*HALF_SIDE_PIXELS.start(), *HALF_SIDE_PIXELS.end()) as f64;
        let offset = |i: i64| (half * (2 * i - ACROSS + 1) as f64 / (ACROSS - 1) as f64) as i64;
        let [column, row] = place.map(|at| at as i64);
        let points: Vec<Vector3<f64>> = (0..ACROSS * ACROSS)
            .filter_map(|i| point(image, [column + offset(i % ACROSS), row + offset(i / ACROSS)]))
            .collect();
        if points.len() < LEAST_POINTS {
            return None;
        }
        let normal = plane(&points)?;
        let cosine = -normal.dot(&middle.normalize());
        let normal = if cosine < 0.0 { -normal } else { normal };
        let cosine = cosine.abs();
        let of_pixel = middle.z.min(FARTHEST_METRES).powi(2) / f64::from(camera.fx * camera.fy);
        (cosine > LEAST_COSINE).then(|| Self { normal, area: pixels * of_pixel / cosine })
    }
}

/// What was measured at a pixel, in the camera's coordinates.
fn point(image: &DownsampledFrame, [column, row]: [i64; 2]) -> Option<Vector3<f64>> {
    let camera = &image.camera;
    let (width, height) = (i64::from(camera.width), i64::from(camera.height));
    if !(0..width).contains(&column) || !(0..height).contains(&row) {
        return None;
    }
    let z = image.depth_metres[(row * width + column) as usize];
    let x = (column as f32 - camera.cx) / camera.fx * z;
    let y = (row as f32 - camera.cy) / camera.fy * z;
    (z > 0.0).then(|| Vector3::new(x, y, z).cast())
}

/// The normal of the plane through points; `None` if they do not lie in one.
fn plane(points: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> =
        points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let [least, middle, _] = order.map(|at| eigen.eigenvalues[at].max(0.0).sqrt());
    (least < FLATNESS * middle).then(|| eigen.eigenvectors.column(order[0]).into_owned())
}
