//! The brightness of an image.

use super::super::downsampled_frame::DownsampledFrame;

/// `[height * width]` brightness, 0 to 255.
pub(in super::super) struct Grey {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Grey {
    pub fn new(image: &DownsampledFrame) -> Self {
        let luma = |rgb: &[u8]| {
            0.299 * f32::from(rgb[0]) + 0.587 * f32::from(rgb[1]) + 0.114 * f32::from(rgb[2])
        };
        Self {
            width: image.camera.width as usize,
            height: image.camera.height as usize,
            values: image.rgb.chunks_exact(3).map(luma).collect(),
        }
    }

    /// The mean over 5x5 pixels; at the border over those that exist.
    pub fn smoothed(&self) -> Self {
        let values = box_sum(&self.values, self.width, self.height, 2);
        let ones = box_sum(&vec![1.0; values.len()], self.width, self.height, 2);
        let values = values.iter().zip(&ones).map(|(sum, count)| sum / count).collect();
        Self { values, ..*self }
    }

    /// The brightness nearest to a place; outside the image that of its border.
    pub fn at(&self, column: f32, row: f32) -> f32 {
        let column = column.round().clamp(0.0, (self.width - 1) as f32) as usize;
        let row = row.round().clamp(0.0, (self.height - 1) as f32) as usize;
        self.values[row * self.width + column]
    }
}

/// The sum of each pixel's neighbours up to `reach` columns and rows away.
pub(super) fn box_sum(values: &[f32], width: usize, height: usize, reach: usize) -> Vec<f32> {
    let mut rows = vec![0.0; values.len()];
    for (from, to) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (column, sum) in to.iter_mut().enumerate() {
            let last = (column + reach).min(width - 1);
            *sum = from[column.saturating_sub(reach)..=last].iter().sum();
        }
    }
    let mut sums = vec![0.0; values.len()];
    for row in 0..height {
        let sum = &mut sums[row * width..(row + 1) * width];
        for other in row.saturating_sub(reach)..=(row + reach).min(height - 1) {
            let from = &rows[other * width..(other + 1) * width];
            sum.iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
        }
    }
    sums
}
