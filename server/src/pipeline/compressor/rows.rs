//! Rows of unit length.

/// Rows shorter than this have no direction and stay as they are.
const MIN_LENGTH: f32 = 1e-6;

/// Scales each row `[n, channels]` to unit length. Rows of nearly zero length stay as they are, so
/// that no value becomes NaN.
pub(crate) fn normalise_rows(rows: &mut [f32], channels: usize) {
    for row in rows.chunks_exact_mut(channels) {
        let length = row.iter().map(|value| value * value).sum::<f32>().sqrt();
        if length > MIN_LENGTH {
            let scale = 1.0 / length;
            row.iter_mut().for_each(|value| *value *= scale);
        }
    }
}
