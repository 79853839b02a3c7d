//! Images of relevancy: resizing and smoothing.

use crate::pipeline::bilinear;

/// The relevancy of each pixel, `[height * width]`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RelevancyMap {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl RelevancyMap {
    /// The value of a pixel.
    #[cfg(test)]
    fn at(&self, row: usize, column: usize) -> f32 {
        self.values[row * self.width + column]
    }

    /// The map at another size, of the same area.
    pub(crate) fn resized(&self, width: usize, height: usize) -> Self {
        let values = bilinear::resized(&self.values, (self.width, self.height), (width, height));
        Self { width, height, values }
    }

    /// The mean over a square of `side` pixels. Beyond its border the image is mirrored at the
    /// border pixels ("reflect 101"). An even square extends one pixel further to the left and up.
    pub(crate) fn smoothed(&self, side: usize) -> Self {
        if side <= 1 {
            return self.clone();
        }
        let mut smoothed = self.clone();
        for row in smoothed.values.chunks_exact_mut(self.width) {
            running_mean(row, side);
        }
        let mut column = vec![0.0; self.height];
        for x in 0..self.width {
            let at = |y: usize| y * self.width + x;
            (0..self.height).for_each(|y| column[y] = smoothed.values[at(y)]);
            running_mean(&mut column, side);
            (0..self.height).for_each(|y| smoothed.values[at(y)] = column[y]);
        }
        smoothed
    }
}

/// Replaces each value by the mean over `side` values around it; the line is mirrored at its ends.
fn running_mean(line: &mut [f32], side: usize) {
    let before = side / 2;
    let mut sums = Vec::with_capacity(line.len() + side);
    let mut sum = 0.0_f64;
    sums.push(sum);
    for i in 0..line.len() + side - 1 {
        sum += f64::from(line[mirrored(i as isize - before as isize, line.len())]);
        sums.push(sum);
    }
    for (i, value) in line.iter_mut().enumerate() {
        *value = ((sums[i + side] - sums[i]) / side as f64) as f32;
    }
}

/// Mirrors `index` into `0..length` without repeating the ends.
fn mirrored(index: isize, length: usize) -> usize {
    if length == 1 {
        return 0;
    }
    let period = 2 * (length as isize - 1);
    let at = index.rem_euclid(period);
    at.min(period - at) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_is_the_mean_with_a_mirrored_border() {
        let line = RelevancyMap { width: 5, height: 1, values: vec![0.0, 0.0, 9.0, 0.0, 3.0] };
        assert_eq!(line.smoothed(3).values, [0.0, 3.0, 3.0, 4.0, 1.0]);
        // An even side extends to the left: x-1 and x.
        assert_eq!(line.smoothed(2).values, [0.0, 0.0, 4.5, 4.5, 1.5]);
        assert_eq!(line.smoothed(1), line);
        // A side much larger than the image is still a mean of its values.
        let wide = line.smoothed(41);
        assert!(wide.values.iter().all(|v| (0.0..=9.0).contains(v)), "{wide:?}");
    }

    #[test]
    fn smoothing_works_along_both_axes_and_keeps_constants() {
        let mut map = RelevancyMap { width: 7, height: 6, values: vec![0.25; 42] };
        assert!(map.smoothed(4).values.iter().all(|v| (v - 0.25).abs() < 1e-6));
        map.values[3 * 7 + 3] = 9.25;
        let smooth = map.smoothed(3);
        assert!((smooth.at(2, 4) - 1.25).abs() < 1e-6 && (smooth.at(4, 2) - 1.25).abs() < 1e-6);
        assert!((smooth.at(1, 3) - 0.25).abs() < 1e-6);
    }

    #[test]
    fn resizing_keeps_ramps_and_positions() {
        let ramp = RelevancyMap {
            width: 8,
            height: 4,
            values: (0..32).map(|i| (i % 8) as f32 + 10.0 * (i / 8) as f32).collect(),
        };
        let large = ramp.resized(16, 8);
        // Pixel (5, 3) of the large image is at 2.25, 1.25 of the small one.
        assert!((large.at(3, 5) - (2.25 + 12.5)).abs() < 1e-5);
        assert_eq!(ramp.resized(8, 4), ramp);
    }
}
