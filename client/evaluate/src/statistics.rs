//! Means, arithmetic and geometric, and evenly spaced samples.

/// The mean; nothing if there are no values.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// The geometric mean of positive numbers; nothing if there are none.
pub(crate) fn geometric_mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    mean(values.map(f64::ln)).map(f64::exp)
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
    fn the_geometric_mean_of_a_number_and_its_inverse_is_one() {
        let found = geometric_mean([0.25, 4.0].into_iter()).unwrap();
        assert!((found - 1.0).abs() < 1e-12, "{found}");
        assert!((geometric_mean([2.0, 8.0].into_iter()).unwrap() - 4.0).abs() < 1e-12);
        assert_eq!(geometric_mean(std::iter::empty()), None);
    }

    #[test]
    fn frames_are_spread_evenly() {
        assert_eq!(spread(&(0..100).collect::<Vec<_>>(), 4), [12, 37, 62, 87]);
        assert_eq!(spread(&[1, 2], 4), [1, 2]);
    }
}
