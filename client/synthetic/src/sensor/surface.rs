//! What a depth image says about the surface at a pixel: edges, and the angle to the ray. Depth is
//! camera z in metres, 0 without a measurement.

use lexsplat_client::dataset::Intrinsics;
use nalgebra::Vector3;

/// Neighbours whose depths differ by more than this share lie on different surfaces. A wall at 80
/// degrees differs by 2.5 % in pictures of 320 columns.
const EDGE_SHARE: f32 = 0.05;

/// Whether two neighbouring depths belong to different surfaces.
pub(super) fn is_edge(a: f32, b: f32) -> bool {
    (a - b).abs() > EDGE_SHARE * a.min(b)
}

/// Smallest and largest depth among the 3x3 pixels around one; `None` without an edge or where one
/// of them is not measured.
pub(super) fn around(depth: &[f32], width: usize, pixel: usize) -> Option<[f32; 2]> {
    let (x, y) = (pixel % width, pixel / width);
    let (mut low, mut high) = (f32::MAX, 0.0_f32);
    for row in y.saturating_sub(1)..(y + 2).min(depth.len() / width) {
        for z in &depth[row * width..][x.saturating_sub(1)..(x + 2).min(width)] {
            (low, high) = (low.min(*z), high.max(*z));
        }
    }
    (low > 0.0 && is_edge(low, high)).then_some([low, high])
}

/// Cosine of the angle between the ray of each pixel and the surface's normal; 1 where it is not
/// known. Of both neighbours in a row or column, the one nearer in depth counts.
pub(super) fn cosines(camera: &Intrinsics, depth: &[f32]) -> Vec<f32> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let point = |pixel: usize| {
        let (u, v) = ((pixel % width) as f64, (pixel / width) as f64);
        let z = f64::from(depth[pixel]);
        Vector3::new((u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z)
    };
    let tangent = |pixel: usize, at: usize, size: usize, step: usize| {
        let before = (at > 0).then(|| pixel - step);
        let after = (at + 1 < size).then(|| pixel + step);
        let known = [before, after].into_iter().flatten().filter(|other| depth[*other] > 0.0);
        let change = |other: &usize| (depth[*other] - depth[pixel]).abs();
        let nearest = known.min_by(|a, b| change(a).total_cmp(&change(b)))?;
        Some(point(nearest) - point(pixel))
    };
    let cosine = |pixel: usize| {
        if depth[pixel] <= 0.0 {
            return None;
        }
        let along_row = tangent(pixel, pixel % width, width, 1)?;
        let along_column = tangent(pixel, pixel / width, height, width)?;
        let normal = along_row.cross(&along_column).try_normalize(0.0)?;
        Some(normal.dot(&point(pixel).normalize()).abs() as f32)
    };
    (0..depth.len()).map(|pixel| cosine(pixel).unwrap_or(1.0)).collect()
}

/// Depth measured on a coarse grid and interpolated: the mean of each cell, then bilinear. Edges
/// become slopes.
pub(super) fn coarse(depth: &[f32], width: usize, grid: [usize; 2]) -> Vec<f32> {
    let height = depth.len() / width;
    let side = (width as f32 / grid[0] as f32).max(height as f32 / grid[1] as f32).max(1.0);
    let count = |size: usize| (size as f32 / side).ceil() as usize;
    let (columns, rows) = (count(width), count(height));
    let range = |at: usize, size: usize| {
        let from = (at as f32 * side) as usize;
        from.min(size - 1)..(((at + 1) as f32 * side).ceil() as usize).min(size)
    };
    let mean = |cell: usize| {
        let (mut sum, mut known) = (0.0, 0_usize);
        for y in range(cell / columns, height) {
            for z in depth[y * width..][range(cell % columns, width)].iter().filter(|z| **z > 0.0) {
                (sum, known) = (sum + z, known + 1);
            }
        }
        if known == 0 { 0.0 } else { sum / known as f32 }
    };
    let cells: Vec<f32> = (0..columns * rows).map(mean).collect();
    let place = |at: usize, count: usize| {
        let at = ((at as f32 + 0.5) / side - 0.5).clamp(0.0, (count - 1) as f32);
        let low = at as usize;
        (low, (low + 1).min(count - 1), at - low as f32)
    };
    let interpolated = |pixel: usize| {
        let (left, right, tx) = place(pixel % width, columns);
        let (top, bottom, ty) = place(pixel / width, rows);
        let cell = |row: usize, column: usize| cells[row * columns + column];
        let corners = [
            (cell(top, left), (1.0 - tx) * (1.0 - ty)),
            (cell(top, right), tx * (1.0 - ty)),
            (cell(bottom, left), (1.0 - tx) * ty),
            (cell(bottom, right), tx * ty),
        ];
        let weight: f32 = corners.iter().filter(|(z, _)| *z > 0.0).map(|(_, w)| w).sum();
        let sum: f32 = corners.iter().map(|(z, w)| z * w).sum();
        if weight < 0.5 { 0.0 } else { sum / weight }
    };
    (0..depth.len()).map(interpolated).collect()
}
