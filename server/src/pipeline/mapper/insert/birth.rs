//! The shape a Gaussian is born with: a disk on the measured surface that fills its square of pixels.
//!
//! In: squares of a picture with depth. Out: Gaussians at the measured depth, flat along the surface's
//! normal, as long as its slant makes them, in the square's mean color. Their language heads start as
//! their color heads and smaller, with codes of zeros ("no language yet"). The paper's are balls at random
//! pixels; disks need no optimisation to lie on a wall.

use super::super::super::backdrop::NOWHERE;
use super::super::super::working::Working;
use super::cells::Cell;
use lexsplat_gpu::{HostGaussians, HostHead};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// Opacity that a Gaussian is born with, as a logit: 0.9.
const OPACITY_LOGIT: f32 = 2.197_224_6;
/// Standard deviation of a newborn in units of its square's side: neighbours close the surface between them, so
/// that nothing has to grow to stop what shows through.
const SCALE: f32 = 0.7;
/// The same of its language head: small things keep their words to themselves.
const LANGUAGE_SCALE: f32 = 0.5;
/// Thickness along the normal, in units of its standard deviation.
const THICKNESS: f32 = 0.2;
/// No disk is longer than this many times its width, however slanted the surface.
const MAX_SLANT: f32 = 3.0;
/// Neighbours whose depths differ by more than this share lie on other surfaces.
const ONE_SURFACE: f32 = 0.05;

/// One Gaussian for each square that has a depth; from `beyond` metres on it is a backdrop's.
pub(super) fn newborns(
    working: &Working,
    cells: &[Cell],
    beyond: f32,
    code_size: usize,
) -> HostGaussians {
    let head = |channels| HostHead { channels, ..HostHead::default() };
    let mut born = HostGaussians { means: Vec::new(), color: head(3), language: head(code_size) };
    for cell in cells {
        let Some(pixel) = middle(working, *cell) else { continue };
        let (mean, rotation, log_scale) = disk(working, pixel, cell.side as f32);
        born.means.push(mean.into());
        let smaller = (LANGUAGE_SCALE / SCALE).ln();
        for (head, shift) in [(&mut born.color, 0.0), (&mut born.language, smaller)] {
            head.rotations.push(rotation);
            head.log_scales.push(log_scale.map(|axis| axis + shift));
        }
        let is_backdrop = working.depth_metres[pixel] >= beyond;
        born.color.opacity_logits.push(OPACITY_LOGIT);
        born.language.opacity_logits.push(if is_backdrop { NOWHERE } else { OPACITY_LOGIT });
        born.color.features.extend(mean_color(working, *cell, working.depth_metres[pixel]));
    }
    born.language.features = vec![0.0; born.means.len() * code_size];
    born
}

/// The measured pixel that is nearest to the square's centre.
fn middle(working: &Working, cell: Cell) -> Option<usize> {
    let width = working.camera.width as usize;
    let half = (cell.side as f32 - 1.0) / 2.0;
    let centre = (cell.left as f32 + half, cell.top as f32 + half);
    let far = |at: &usize| {
        let (x, y) = ((at % width) as f32 - centre.0, (at / width) as f32 - centre.1);
        x * x + y * y
    };
    cell.pixels(working)
        .filter(|at| working.depth_metres[*at] > 0.0)
        .min_by(|a, b| far(a).total_cmp(&far(b)))
}

/// The mean of the square's pixels that are of the surface at this depth, 0 to 1.
fn mean_color(working: &Working, cell: Cell, depth: f32) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    let on_surface = |at: &usize| (working.depth_metres[*at] - depth).abs() <= ONE_SURFACE * depth;
    for at in cell.pixels(working).filter(on_surface) {
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum += f32::from(working.rgb[at * 3 + channel]) / 255.0;
        }
        count += 1.0;
    }
    sum.map(|sum| sum / f32::max(count, 1.0))
}

/// Centre, rotation (w, x, y, z) and logarithms of the scales, metres, of a disk whose picture is
/// round and has `SCALE * side` pixels' standard deviation.
fn disk(working: &Working, pixel: usize, side: f32) -> (Point3<f32>, [f32; 4], [f32; 3]) {
    let camera = &working.camera;
    let width = camera.width as usize;
    let depth = working.depth_metres[pixel];
    let mean = camera.unproject((pixel % width) as f32, (pixel / width) as f32, depth);
    let radius = SCALE * side * depth / camera.fx;
    let eye = camera.camera_from_world.inverse_transform_point(&Point3::origin());
    let sight = (mean - eye).normalize();
    let normal = normal(working, pixel).unwrap_or(sight);
    let slant = normal.dot(&sight).abs().max(1.0 / MAX_SLANT);
    // Along the slope the disk is longer, so that it looks round from here.
    let slope = sight - normal * normal.dot(&sight);
    let slope = slope.try_normalize(1e-4).unwrap_or_else(|| across(&normal));
    let axes = Matrix3::from_columns(&[slope, normal.cross(&slope), normal]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let scales = [radius / slant, radius, THICKNESS * radius];
    (mean, [rotation.w, rotation.i, rotation.j, rotation.k], scales.map(f32::ln))
}

/// Any unit vector at right angles.
fn across(normal: &Vector3<f32>) -> Vector3<f32> {
    let axis = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    normal.cross(&axis).normalize()
}

/// The surface's unit normal in the world, from the neighbours on it; `None` at edges and holes.
fn normal(working: &Working, pixel: usize) -> Option<Vector3<f32>> {
    let camera = &working.camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let (column, row) = (pixel % width, pixel / width);
    let depth = working.depth_metres[pixel];
    let point = |column: usize, row: usize| {
        let there = working.depth_metres[row * width + column];
        let same = there > 0.0 && (there - depth).abs() <= ONE_SURFACE * depth;
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
    use super::super::tests::working;
    use super::*;

    const CELL: Cell = Cell { left: 2, top: 2, side: 2 };

    #[test]
    fn newborns_lie_on_the_surface_and_have_no_language() {
        let born = newborns(&working(6), &[CELL], f32::INFINITY, 15);
        assert!((born.means[0][2] - 2.0).abs() < 1e-6, "at the measured depth");
        assert!((born.color.features[0] - 128.0 / 255.0).abs() < 1e-6);
        assert_eq!(born.language.features, vec![0.0; 15]);
        let [long, wide, thick] = born.color.log_scales[0].map(f32::exp);
        assert!((long / wide - 1.0).abs() < 0.05 && thick < 0.3 * wide, "{long} {wide} {thick}");
        assert!((wide - SCALE * 2.0 * 2.0 / 6.0).abs() < 1e-5, "a share of its square: {wide}");
        let language = born.language.log_scales[0][1].exp();
        assert!((language / wide - LANGUAGE_SCALE / SCALE).abs() < 1e-5, "smaller: {language}");
    }

    #[test]
    fn a_slanted_surface_gets_disks_that_lie_on_it() {
        let mut slanted = working(6);
        // z = 2 + x/4: the normal is (1, 0, -4) / sqrt(17).
        let depth = |u: f32| 2.0 / (1.0 - 0.25 * (u - 2.5) / 6.0);
        slanted.depth_metres = (0..36).map(|at| depth((at % 6) as f32)).collect();
        let born = newborns(&slanted, &[CELL], f32::INFINITY, 1);
        let [w, x, y, z] = born.color.rotations[0];
        let turn = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
        let truth = Vector3::new(1.0, 0.0, -4.0).normalize();
        let cosine = (turn * Vector3::z()).dot(&truth).abs();
        assert!(cosine > 0.999, "{cosine}");
        let away = (turn * Vector3::x()).dot(&truth).abs();
        assert!(away < 0.05, "its long axis lies in the surface: {away}");
        let scales = born.color.log_scales[0].map(f32::exp);
        assert!(scales[0] > 1.01 * scales[1], "longer along the slope: {scales:?}");
    }

    #[test]
    fn nothing_is_born_without_a_measurement() {
        let blind = Working { depth_metres: vec![0.0; 36].into(), ..working(6) };
        assert!(newborns(&blind, &[CELL], f32::INFINITY, 15).is_empty());
    }
}
