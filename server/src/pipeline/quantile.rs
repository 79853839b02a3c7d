//! Quantiles of unsorted values.

/// The value that this share (0 to 1) of the values is below; `None` if there are none, or if it is not
/// finite. The values are put into another order.
pub(super) fn quantile(values: &mut [f32], share: f32) -> Option<f32> {
    let at = (values.len() as f32 * share) as usize;
    if at >= values.len() {
        return None;
    }
    let (_, value, _) = values.select_nth_unstable_by(at, f32::total_cmp);
    value.is_finite().then_some(*value)
}

/// The middle value; `None` as for [`quantile`].
pub(super) fn median(values: &mut [f32]) -> Option<f32> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_the_values_is_below_a_quantile() {
        let mut values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(quantile(&mut values, 0.0), Some(1.0));
        assert_eq!(median(&mut values), Some(3.0));
        assert_eq!(quantile(&mut values, 1.0), None);
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [f32::NAN]), None);
    }
}
