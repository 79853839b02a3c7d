//! Reference, not for production: the plain loop.

/// Exclusive prefix sum, saturating.
pub fn exclusive(values: &[u32]) -> Vec<u32> {
    let mut before = 0u32;
    values
        .iter()
        .map(|value| {
            let here = before;
            before = before.saturating_add(*value);
            here
        })
        .collect()
}
