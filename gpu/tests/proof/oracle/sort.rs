//! Reference, not for production: the standard library's stable sort.

/// Keys and payload, sorted by the low `bits` bits of the key; equal keys keep their order.
pub fn sort(keys: &[u32], values: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
    let mask = if bits >= 32 { u32::MAX } else { (1 << bits) - 1 };
    let mut pairs: Vec<_> = keys.iter().copied().zip(values.iter().copied()).collect();
    pairs.sort_by_key(|(key, _)| key & mask);
    pairs.into_iter().unzip()
}
