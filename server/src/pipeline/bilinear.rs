//! Images of one channel in another size: bilinear, pixel centres at half pixels, so that both cover the
//! same area (torch's `align_corners=False`).

/// Two neighbours and how far it is to the second.
struct Taps {
    low: usize,
    high: usize,
    share: f32,
}

impl Taps {
    fn all(from: usize, to: usize) -> Vec<Self> {
        let scale = from as f32 / to as f32;
        let tap = |i: usize| {
            let at = ((i as f32 + 0.5) * scale - 0.5).clamp(0.0, (from - 1) as f32);
            let low = at as usize;
            Self { low, high: (low + 1).min(from - 1), share: at - low as f32 }
        };
        (0..to).map(tap).collect()
    }

    fn mix(&self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.share
    }
}

/// `values` of size `from` = (width, height), row-major, at size `to`.
pub(super) fn resized(values: &[f32], from: (usize, usize), to: (usize, usize)) -> Vec<f32> {
    let (columns, rows) = (Taps::all(from.0, to.0), Taps::all(from.1, to.1));
    let mut found = Vec::with_capacity(to.0 * to.1);
    for row in &rows {
        let upper = &values[row.low * from.0..][..from.0];
        let lower = &values[row.high * from.0..][..from.0];
        found.extend(columns.iter().map(|column| {
            row.mix(
                column.mix(upper[column.low], upper[column.high]),
                column.mix(lower[column.low], lower[column.high]),
            )
        }));
    }
    found
}
