//! Means and evenly spaced samples.

/// The mean; nothing if there are no values.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// `count` of the items, evenly spaced, or all if there are fewer.
pub(crate) fn spread<T: Copy>(of: &[T], count: usize) -> Vec<T> {
    if of.len() <= count {
        return of.to_vec();
    }
    (0..count).map(|i| of[(2 * i + 1) * of.len() / (2 * count)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_evenly() {
        assert_eq!(spread(&(0..100).collect::<Vec<_>>(), 4), [12, 37, 62, 87]);
        assert_eq!(spread(&[1, 2], 4), [1, 2]);
    }
}
