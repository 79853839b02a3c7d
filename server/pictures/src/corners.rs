//! Corners: places whose surroundings change in every direction (Shi and Tomasi 1994).

use crate::grey::{Grey, box_sum};
use crate::picture::Picture;

/// Each cell of this many columns and rows gives at most one corner, so that they cover the image.
const CELL: usize = 12;
/// Pixels at the border where no corner is looked for.
const BORDER: usize = 4;
/// Least smaller eigenvalue of the summed gradients, brightness² of 5x5 pixels.
const LEAST: f32 = 8.0;
/// Corners of one image at most.
const MAX_CORNERS: usize = 800;
/// Neighbouring pixels lie on one surface if their depths differ by at most this share.
const SAME_SURFACE: f32 = 0.03;

/// Columns and rows of corners, the most distinct first.
pub(crate) fn find(image: &Grey) -> Vec<[usize; 2]> {
    let score = smaller_eigenvalues(image);
    let Grey { width, height, .. } = *image;
    let mut found: Vec<(f32, [usize; 2])> = Vec::new();
    for top in (BORDER..height.saturating_sub(BORDER)).step_by(CELL) {
        for left in (BORDER..width.saturating_sub(BORDER)).step_by(CELL) {
            let (right, bottom) =
                ((left + CELL).min(width - BORDER), (top + CELL).min(height - BORDER));
            let mut best = (LEAST, None);
            for row in top..bottom {
                for (at, score) in score[row * width..][left..right].iter().enumerate() {
                    if *score > best.0 {
                        best = (*score, Some([left + at, row]));
                    }
                }
            }
            found.extend(best.1.map(|place| (best.0, place)));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(MAX_CORNERS);
    found.into_iter().map(|(_, place)| place).collect()
}

/// The smaller eigenvalue of the 2x2 matrix of gradients, summed over 5x5 pixels.
fn smaller_eigenvalues(image: &Grey) -> Vec<f32> {
    let Grey { width, height, values } = image;
    let mut products = [(); 3].map(|()| vec![0.0; values.len()]);
    for row in 1..height.saturating_sub(1) {
        let inner = row * width + 1..(row + 1) * width - 1;
        let [xx, xy, yy] = products.each_mut().map(|product| &mut product[inner.clone()]);
        let here = &values[inner.start - 1..inner.end + 1];
        let above = &values[inner.start - width..inner.end - width];
        let below = &values[inner.start + width..inner.end + width];
        for at in 0..inner.len() {
            let dx = 0.5 * (here[at + 2] - here[at]);
            let dy = 0.5 * (below[at] - above[at]);
            xx[at] = dx * dx;
            xy[at] = dx * dy;
            yy[at] = dy * dy;
        }
    }
    let [xx, xy, yy] = products.map(|product| box_sum(&product, *width, *height));
    let smaller = |((xx, xy), yy): ((&f32, &f32), &f32)| {
        0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt())
    };
    xx.iter().zip(&xy).zip(&yy).map(smaller).collect()
}

/// Depth of a corner, metres: the mean of the nearest surface in 3x3 pixels; `None` without one.
pub(crate) fn depth(image: &Picture<'_>, column: usize, row: usize) -> Option<f32> {
    let width = image.width;
    let around = (row - 1..=row + 1)
        .flat_map(|row| (column - 1..=column + 1).map(move |column| row * width + column))
        .map(|at| image.depth_metres[at])
        .filter(|depth| *depth > 0.0);
    let nearest = around.clone().fold(f32::INFINITY, f32::min);
    let (sum, count) = around
        .filter(|depth| *depth <= nearest * (1.0 + SAME_SURFACE))
        .fold((0.0, 0), |(sum, count), depth| (sum + depth, count + 1));
    (count > 0).then(|| sum / count as f32)
}
