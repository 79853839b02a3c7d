//! Relevancy maps of images: smoothing and peaks.

/// The relevancy of every pixel of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Heatmap {
    /// Columns.
    pub width: usize,
    /// `[height * width]`, row by row.
    pub values: Vec<f32>,
}

impl Heatmap {
    /// The mean over a square of `side` pixels. The image is mirrored at its outermost pixels. An
    /// even side reaches one pixel further left and up. Sides 0 and 1 change nothing.
    pub fn smoothed(&self, side: usize) -> Self {
        if side < 2 {
            return self.clone();
        }
        let by_rows = smooth_rows(&self.values, self.width, side);
        let height = self.values.len() / self.width;
        let columns = transposed(&by_rows, self.width);
        let values = transposed(&smooth_rows(&columns, height, side), height);
        Self { width: self.width, values }
    }

    /// Column and row of the first pixel with the greatest value; `None` if no value is above 0.
    pub fn peak(&self) -> Option<(usize, usize)> {
        let mut best = (0.0, None);
        for (at, &value) in self.values.iter().enumerate() {
            if value > best.0 {
                best = (value, Some(at));
            }
        }
        best.1.map(|at| (at % self.width, at / self.width))
    }
}

fn smooth_rows(values: &[f32], width: usize, side: usize) -> Vec<f32> {
    let mirrored = |at: isize| {
        let period = (2 * (width as isize - 1)).max(1);
        let at = at.rem_euclid(period);
        at.min(period - at) as usize
    };
    let reach = (side / 2) as isize;
    let mut out = Vec::with_capacity(values.len());
    for row in values.chunks_exact(width) {
        let mut sums = vec![0.0_f64];
        for at in -reach..width as isize + side as isize - reach - 1 {
            let value = row[mirrored(at).min(width - 1)];
            sums.push(sums[sums.len() - 1] + f64::from(value));
        }
        out.extend((0..width).map(|x| ((sums[x + side] - sums[x]) / side as f64) as f32));
    }
    out
}

fn transposed(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width;
    (0..values.len()).map(|at| values[at % height * width + at / height]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_is_a_mean_with_a_mirrored_border() {
        let line = Heatmap { width: 5, values: vec![0.0, 0.0, 9.0, 0.0, 3.0] };
        assert_eq!(line.smoothed(3).values, [0.0, 3.0, 3.0, 4.0, 1.0]);
        assert_eq!(line.smoothed(2).values, [0.0, 0.0, 4.5, 4.5, 1.5]);
        let column = Heatmap { width: 1, values: line.values.clone() };
        assert_eq!(column.smoothed(3).values, line.smoothed(3).values);
        assert!(line.smoothed(41).values.iter().all(|v| (0.0..=9.0).contains(v)));
    }

    #[test]
    fn the_peak_is_the_first_maximum_and_an_empty_map_has_none() {
        let plane = |values: [f32; 6]| Heatmap { width: 3, values: values.to_vec() };
        assert_eq!(plane([0.1, f32::NAN, 0.3, 0.9, 0.2, 0.9]).peak(), Some((0, 1)));
        assert_eq!(plane([0.0; 6]).peak(), None);
    }
}
