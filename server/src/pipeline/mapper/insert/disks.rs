//! The initial shape of a Gaussian: a disk on the measured surface that fills its cell.
//!
//! In: cells of an image with depth. Out: Gaussians at the measured depth, flat along the surface normal,
//! longer along an edge of the image and along the slant of the surface, in the cell's mean color. Their
//! language heads are a little smaller and have codes of zeros ("no language yet"). The paper starts with
//! balls at random pixels; disks lie on a wall without any optimisation.

use super::super::super::backdrop::BACKDROP_LOGIT;
use super::super::super::downsampled_frame::DownsampledFrame;
use super::edge::{Edge, edge};
use super::quadtree::Cell;
use lexsplat_gpu::{HostGaussians, HostHead};
use lexsplat_pictures::Grey;
use nalgebra::{
    Matrix2, Matrix3, Point3, Rotation3, SymmetricEigen, UnitQuaternion, Vector2, Vector3,
};

/// Initial opacity 0.9, as a logit.
const OPACITY_LOGIT: f32 = 2.197_224_6;
/// Initial standard deviation in units of the cell's side. Neighbours overlap and close the surface, so that
/// none has to grow to cover what shines through.
const SCALE: f32 = 0.7;
/// The same of the language head. Smaller, so that the language of small objects stays on them.
const LANGUAGE_SCALE: f32 = 0.5;
/// Standard deviation along the normal, in units of the one along the surface.
const THICKNESS: f32 = 0.2;
/// Logarithm of the factor by which a disk on a clear edge is longer along it, and narrower across.
const EDGE_STRETCH: f32 = 0.5;
/// Largest ratio of a disk's length to its width on a slanted surface.
const MAX_SLANT: f32 = 3.0;
/// Neighbouring pixels lie on the same surface if their depths differ by at most this share.
const SAME_SURFACE: f32 = 0.05;

/// One Gaussian for each cell that has a depth. Depths of `backdrop_metres` and more give backdrop Gaussians.
pub(super) fn new_gaussians(
    image: &DownsampledFrame,
    cells: &[Cell],
    backdrop_metres: f32,
    code_size: usize,
) -> HostGaussians {
    let head = |channels| HostHead { channels, ..HostHead::default() };
    let mut new = HostGaussians { means: Vec::new(), color: head(3), language: head(code_size) };
    let grey = Grey::new(&image.picture());
    for cell in cells {
        let Some(pixel) = middle(image, *cell) else { continue };
        let Disk { mean, rotation, log_scales } = disk(image, pixel, *cell, edge(&grey, *cell));
        new.means.push(mean.into());
        let smaller = (LANGUAGE_SCALE / SCALE).ln();
        for (head, shift) in [(&mut new.color, 0.0), (&mut new.language, smaller)] {
            head.rotations.push(rotation);
            head.log_scales.push(log_scales.map(|axis| axis + shift));
        }
        let is_backdrop = image.depth_metres[pixel] >= backdrop_metres;
        new.color.opacity_logits.push(OPACITY_LOGIT);
        new.language.opacity_logits.push(if is_backdrop { BACKDROP_LOGIT } else { OPACITY_LOGIT });
        new.color.features.extend(mean_color(image, *cell, image.depth_metres[pixel]));
    }
    new.language.features = vec![0.0; new.means.len() * code_size];
    new
}

/// Index of the measured pixel nearest to the cell's centre.
fn middle(image: &DownsampledFrame, cell: Cell) -> Option<usize> {
    let width = image.camera.width as usize;
    let half = (cell.side as f32 - 1.0) / 2.0;
    let centre = (cell.left as f32 + half, cell.top as f32 + half);
    let far = |at: &usize| {
        let (x, y) = ((at % width) as f32 - centre.0, (at / width) as f32 - centre.1);
        x * x + y * y
    };
    cell.pixels(image)
        .filter(|at| image.depth_metres[*at] > 0.0)
        .min_by(|a, b| far(a).total_cmp(&far(b)))
}

/// Mean color of the cell's pixels on the surface at this depth, RGB, 0 to 1.
fn mean_color(image: &DownsampledFrame, cell: Cell, depth: f32) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    let on_surface = |at: &usize| (image.depth_metres[*at] - depth).abs() <= SAME_SURFACE * depth;
    for at in cell.pixels(image).filter(on_surface) {
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum += f32::from(image.rgb[at * 3 + channel]) / 255.0;
        }
        count += 1.0;
    }
    sum.map(|sum| sum / f32::max(count, 1.0))
}

/// Position and shape of a Gaussian.
struct Disk {
    /// Metres, in the world.
    mean: Point3<f32>,
    /// Quaternion (w, x, y, z).
    rotation: [f32; 4],
    /// Logarithms of the standard deviations, metres: the longest, across it, along the normal.
    log_scales: [f32; 3],
}

/// A disk on the surface at a pixel. It looks like a circle of `SCALE` times the cell's side, stretched along
/// the edge in the cell.
fn disk(image: &DownsampledFrame, pixel: usize, cell: Cell, edge: Edge) -> Disk {
    let camera = &image.camera;
    let width = camera.width as usize;
    let depth = image.depth_metres[pixel];
    let mean = camera.unproject((pixel % width) as f32, (pixel / width) as f32, depth);
    let radius = SCALE * cell.side as f32 * depth / camera.fx;
    let eye = camera.camera_from_world.inverse_transform_point(&Point3::origin());
    let sight = (mean - eye).normalize();
    let normal = normal(image, pixel).unwrap_or(sight);
    let slant = normal.dot(&sight).abs().max(1.0 / MAX_SLANT);
    // Axes on the surface: along the slope, which is foreshortened, and across it.
    let slope = sight - normal * normal.dot(&sight);
    let slope = slope.try_normalize(1e-4).unwrap_or_else(|| across(&normal));
    let level = normal.cross(&slope);
    let Edge { direction, clarity } = edge;
    let world_from_camera = camera.camera_from_world.rotation.inverse();
    let direction = world_from_camera * Vector3::new(direction.x, direction.y, 0.0);
    let shown_slope = (slope - sight * sight.dot(&slope)).try_normalize(1e-4).unwrap_or(slope);
    let along = Vector2::new(direction.dot(&shown_slope), direction.dot(&level));
    let along = along.try_normalize(0.0).unwrap_or_else(Vector2::x);
    let stretch = (EDGE_STRETCH * clarity).exp();
    let (longest, length, breadth) = ellipse(along, stretch, slant);
    let axis = slope * longest.x + level * longest.y;
    let axes = Matrix3::from_columns(&[axis, normal.cross(&axis), normal]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let scales = [radius * length, radius * breadth, THICKNESS * radius];
    Disk {
        mean,
        rotation: [rotation.w, rotation.i, rotation.j, rotation.k],
        log_scales: scales.map(f32::ln),
    }
}

/// The ellipse on a surface that looks like a unit circle, stretched by a factor along a unit vector and
/// squeezed by it across. The x axis of the surface looks shorter, by the factor `slant`. Returns the
/// direction of the longest axis, its length and the length of the other one.
fn ellipse(along: Vector2<f32>, stretch: f32, slant: f32) -> (Vector2<f32>, f32, f32) {
    let turn = Matrix2::new(along.x, -along.y, along.y, along.x);
    let shown = turn * Matrix2::new(stretch, 0.0, 0.0, 1.0 / stretch);
    let on_surface = Matrix2::new(1.0 / slant, 0.0, 0.0, 1.0) * shown;
    let axes = SymmetricEigen::new(on_surface * on_surface.transpose());
    let longest = axes.eigenvalues.imax();
    let [length, breadth] = [axes.eigenvalues[longest], axes.eigenvalues[1 - longest]];
    (axes.eigenvectors.column(longest).into_owned(), length.sqrt(), breadth.sqrt())
}

/// A unit vector perpendicular to the normal.
fn across(normal: &Vector3<f32>) -> Vector3<f32> {
    let axis = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    normal.cross(&axis).normalize()
}

/// Unit normal of the surface in the world, from the neighbouring pixels on it; `None` at edges and holes.
fn normal(image: &DownsampledFrame, pixel: usize) -> Option<Vector3<f32>> {
    let camera = &image.camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let (column, row) = (pixel % width, pixel / width);
    let depth = image.depth_metres[pixel];
    let point = |column: usize, row: usize| {
        let there = image.depth_metres[row * width + column];
        let same = there > 0.0 && (there - depth).abs() <= SAME_SURFACE * depth;
        same.then(|| camera.unproject(column as f32, row as f32, there))
    };
    let here = point(column, row)?;
    let right = (column + 1 < width).then(|| point(column + 1, row)).flatten();
    let left = column.checked_sub(1).and_then(|column| point(column, row));
    let below = (row + 1 < height).then(|| point(column, row + 1)).flatten();
    let above = row.checked_sub(1).and_then(|row| point(column, row));
    let between = |after: Option<Point3<f32>>, before: Option<Point3<f32>>| match (after, before) {
        (None, None) => None,
        (after, before) => Some(after.unwrap_or(here) - before.unwrap_or(here)),
    };
    between(right, left)?.cross(&between(below, above)?).try_normalize(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::tests::wall;
    use super::*;

    const CELL: Cell = Cell { left: 2, top: 2, side: 2 };

    #[test]
    fn new_gaussians_lie_on_the_surface_and_have_no_language() {
        let new = new_gaussians(&wall(6), &[CELL], f32::INFINITY, 15);
        assert!((new.means[0][2] - 2.0).abs() < 1e-6, "at the measured depth");
        assert!((new.color.features[0] - 128.0 / 255.0).abs() < 1e-6);
        assert_eq!(new.language.features, vec![0.0; 15]);
        let [long, wide, thick] = new.color.log_scales[0].map(f32::exp);
        assert!((long / wide - 1.0).abs() < 0.05 && thick < 0.3 * wide, "{long} {wide} {thick}");
        assert!((wide - SCALE * 2.0 * 2.0 / 6.0).abs() < 1e-5, "a share of its cell: {wide}");
        let language = new.language.log_scales[0][1].exp();
        assert!((language / wide - LANGUAGE_SCALE / SCALE).abs() < 1e-5, "smaller: {language}");
    }

    #[test]
    fn a_slanted_surface_gets_disks_that_lie_on_it() {
        let mut slanted = wall(6);
        // z = 2 + x/4: the normal is (1, 0, -4) / sqrt(17).
        let depth = |u: f32| 2.0 / (1.0 - 0.25 * (u - 2.5) / 6.0);
        slanted.depth_metres = (0..36).map(|at| depth((at % 6) as f32)).collect();
        let new = new_gaussians(&slanted, &[CELL], f32::INFINITY, 1);
        let [w, x, y, z] = new.color.rotations[0];
        let turn = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
        let truth = Vector3::new(1.0, 0.0, -4.0).normalize();
        let cosine = (turn * Vector3::z()).dot(&truth).abs();
        assert!(cosine > 0.999, "{cosine}");
        let away = (turn * Vector3::x()).dot(&truth).abs();
        assert!(away < 0.05, "its long axis lies in the surface: {away}");
        let scales = new.color.log_scales[0].map(f32::exp);
        assert!(scales[0] > 1.01 * scales[1], "longer along the slope: {scales:?}");
    }

    #[test]
    fn a_disk_lies_along_the_edge_in_its_cell() {
        let cell = Cell { left: 2, top: 2, side: 4 };
        let striped = |is_bright: fn(usize, usize) -> bool| {
            let mut image = wall(8);
            let value = |at: usize| if is_bright(at / 3 % 8, at / 24) { 200 } else { 40 };
            image.rgb = (0..8 * 8 * 3).map(value).collect();
            new_gaussians(&image, &[cell], f32::INFINITY, 1)
        };
        let longest = |new: &HostGaussians| {
            let [w, x, y, z] = new.color.rotations[0];
            UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z)) * Vector3::x()
        };
        let ratio =
            |new: &HostGaussians| (new.color.log_scales[0][0] - new.color.log_scales[0][1]).exp();
        let upright = striped(|x, _| x < 4);
        assert!(longest(&upright).y.abs() > 0.99, "{:?}", longest(&upright));
        assert!(ratio(&upright) > 2.5, "{}", ratio(&upright));
        let level = striped(|_, y| y < 4);
        assert!(longest(&level).x.abs() > 0.99, "{:?}", longest(&level));
        let flat = striped(|_, _| true);
        assert!(ratio(&flat) < 1.1, "negative control: {}", ratio(&flat));
    }

    #[test]
    fn an_ellipse_undoes_the_slant_and_keeps_its_area_in_the_image() {
        let (axis, length, breadth) = ellipse(Vector2::y(), 1.0, 0.5);
        assert!(
            axis.x.abs() > 0.999 && (length - 2.0).abs() < 1e-5 && (breadth - 1.0).abs() < 1e-5
        );
        let (axis, length, breadth) = ellipse(Vector2::y(), 4.0, 0.5);
        assert!(
            axis.y.abs() > 0.999 && (length - 4.0).abs() < 1e-4 && (breadth - 0.5).abs() < 1e-4
        );
        let diagonal = Vector2::new(0.6, 0.8);
        let (_, length, breadth) = ellipse(diagonal, 3.0, 0.5);
        assert!((length * breadth * 0.5 - 1.0).abs() < 1e-4, "{length} {breadth}");
    }

    #[test]
    fn nothing_is_inserted_without_a_measurement() {
        let blind = DownsampledFrame { depth_metres: vec![0.0; 36].into(), ..wall(6) };
        assert!(new_gaussians(&blind, &[CELL], f32::INFINITY, 15).is_empty());
    }
}
