//! Conversion of colors to bytes.

/// 0..1 to 0..255. Values beyond the range are clamped; NaN becomes 0.
pub(super) fn to_byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_clamped() {
        assert_eq!([-1.0, 0.0, 0.5, 1.0, 7.0, f32::NAN].map(to_byte), [0, 0, 128, 255, 255, 0]);
    }
}
