//! Bilinear resizing of images of one channel. Pixel centres are at half pixels, so that source and
//! result cover the same area (PyTorch's `align_corners=False`).

/// Two neighbouring source pixels and the weight of the second.
struct Taps {
    low: usize,
    high: usize,
    weight: f32,
}

impl Taps {
    fn all(from: usize, to: usize) -> Vec<Self> {
        let scale = from as f32 / to as f32;
        let tap = |i: usize| {
            let at = ((i as f32 + 0.5) * scale - 0.5).clamp(0.0, (from - 1) as f32);
            let low = at as usize;
            Self { low, high: (low + 1).min(from - 1), weight: at - low as f32 }
        };
        (0..to).map(tap).collect()
    }

    fn mix(&self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.weight
    }
}

/// Resizes `values`, row-major, from size `from` to size `to`; sizes are (width, height).
pub(super) fn resized(values: &[f32], from: (usize, usize), to: (usize, usize)) -> Vec<f32> {
    let (columns, rows) = (Taps::all(from.0, to.0), Taps::all(from.1, to.1));
    let mut resized = Vec::with_capacity(to.0 * to.1);
    for row in &rows {
        let upper = &values[row.low * from.0..][..from.0];
        let lower = &values[row.high * from.0..][..from.0];
        resized.extend(columns.iter().map(|column| {
            row.mix(
                column.mix(upper[column.low], upper[column.high]),
                column.mix(lower[column.low], lower[column.high]),
            )
        }));
    }
    resized
}
