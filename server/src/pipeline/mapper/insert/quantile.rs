//! Quantiles of unsorted values.

/// The value that this share of the values is below; `None` if there are none.
pub(super) fn quantile(mut values: Vec<f32>, share: f32) -> Option<f32> {
    let at = (values.len() as f32 * share) as usize;
    if at >= values.len() {
        return None;
    }
    let (_, value, _) = values.select_nth_unstable_by(at, f32::total_cmp);
    value.is_finite().then_some(*value)
}
