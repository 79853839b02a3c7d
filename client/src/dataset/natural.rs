//! The order of names in which numbers count as numbers.

use std::cmp::Ordering;

/// Compares names so that `frame_9` comes before `frame_10`.
pub(crate) fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a_rest, mut b_rest) = (a, b);
    while let (Some(a_first), Some(b_first)) = (a_rest.chars().next(), b_rest.chars().next()) {
        let (a_digits, b_digits) = (digits(a_rest), digits(b_rest));
        if a_digits.is_empty() || b_digits.is_empty() {
            match a_first.cmp(&b_first) {
                Ordering::Equal => {}
                other => return other,
            }
            a_rest = &a_rest[a_first.len_utf8()..];
            b_rest = &b_rest[b_first.len_utf8()..];
            continue;
        }
        let value = |digits: &str| {
            let shown = digits.trim_start_matches('0');
            (shown.len(), shown.to_owned())
        };
        match value(a_digits).cmp(&value(b_digits)) {
            Ordering::Equal => {}
            other => return other,
        }
        (a_rest, b_rest) = (&a_rest[a_digits.len()..], &b_rest[b_digits.len()..]);
    }
    a_rest.len().cmp(&b_rest.len()).then_with(|| a.cmp(b))
}

/// The digits that a text begins with.
fn digits(text: &str) -> &str {
    &text[..text.bytes().take_while(u8::is_ascii_digit).count()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_as_numbers() {
        let mut names =
            ["f10", "f9", "f09", "e11", "f1.5", "f1", "ü2", "f", "f99999999999999999999"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(
            names,
            ["e11", "f", "f1", "f1.5", "f09", "f9", "f10", "f99999999999999999999", "ü2"]
        );
    }
}
