//! The brightness of a picture.

use crate::picture::Picture;

/// `[height * width]` brightness, 0 to 255.
pub struct Grey {
    /// Columns, pixels.
    pub width: usize,
    /// Rows, pixels.
    pub height: usize,
    /// Row by row.
    pub values: Vec<f32>,
}

/// Pixels to each side that [`Grey::smoothed`] and [`box_sum`] look at.
pub(crate) const REACH: usize = 2;

impl Grey {
    /// That of a picture.
    pub fn new(picture: &Picture<'_>) -> Self {
        let luma = |rgb: &[u8]| {
            0.299 * f32::from(rgb[0]) + 0.587 * f32::from(rgb[1]) + 0.114 * f32::from(rgb[2])
        };
        Self {
            width: picture.width,
            height: picture.height,
            values: picture.rgb.chunks_exact(3).map(luma).collect(),
        }
    }

    /// The mean over 5x5 pixels; at the border over those that exist.
    pub(crate) fn smoothed(&self) -> Self {
        let Self { width, height, .. } = *self;
        let mut values = box_sum(&self.values, width, height);
        for (row, sums) in values.chunks_exact_mut(width.max(1)).enumerate() {
            let rows = around(row, height).len();
            for (column, sum) in sums.iter_mut().enumerate() {
                *sum /= (rows * around(column, width).len()) as f32;
            }
        }
        Self { values, width, height }
    }

    /// The brightness nearest to a place; outside the picture that of its border.
    pub(crate) fn at(&self, column: f32, row: f32) -> f32 {
        let nearest = |at: f32, size: usize| (at.clamp(0.0, (size - 1) as f32) + 0.5) as usize;
        self.values[nearest(row, self.height) * self.width + nearest(column, self.width)]
    }
}

/// What lies up to [`REACH`] from a place, within `size`.
fn around(at: usize, size: usize) -> std::ops::Range<usize> {
    at.saturating_sub(REACH)..(at + REACH + 1).min(size)
}

/// The sum of each pixel's neighbours up to [`REACH`] columns and rows away.
pub(crate) fn box_sum(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let mut rows = vec![0.0; values.len()];
    for (from, to) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        let inner = REACH..width.saturating_sub(REACH).max(REACH);
        for column in (0..width).filter(|column| !inner.contains(column)) {
            to[column] = from[around(column, width)].iter().sum();
        }
        for (window, sum) in from.windows(2 * REACH + 1).zip(to.iter_mut().skip(REACH)) {
            *sum = window.iter().sum();
        }
    }
    let mut sums = vec![0.0; values.len()];
    for (row, sum) in sums.chunks_exact_mut(width).enumerate() {
        for other in around(row, height) {
            let from = &rows[other * width..(other + 1) * width];
            sum.iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
        }
    }
    sums
}
