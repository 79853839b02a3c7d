//! Permitted ranges of configured numbers.
//!
//! In: a key with its value and its range. Out: nothing, or an [`OutOfRange`] that names all three.
//! The `check` of each stage's config is a list of these. NaN and infinities are in no range.

use std::fmt::Display;
use std::ops::RangeInclusive;

/// The longest time that can be set: a day, seconds.
pub(crate) const DAY: u64 = 24 * 3600;
/// Most things that can wait in a queue or stay in a cache.
pub(crate) const MAX_KEPT: usize = 1 << 16;
/// Most steps, keyframes or other things that are counted and take time.
pub(crate) const MAX_COUNT: usize = 1_000_000;
/// Most pixels of an image.
pub(crate) const MAX_PIXELS: u64 = 1 << 30;
/// Most columns of an image.
pub(crate) const MAX_COLUMNS: u32 = 1 << 14;
/// Most bytes of what stays in memory: a tebibyte.
pub(crate) const MAX_BYTES: usize = 1 << 40;

/// A setting outside its permitted range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} is {found}: expected {expected}")]
pub struct OutOfRange {
    /// Section and key, `section.key`.
    pub key: &'static str,
    /// The configured value.
    pub found: String,
    /// The permitted range.
    pub expected: String,
}

/// A number that can be configured.
pub(crate) trait Number: Copy + Display + PartialOrd {
    /// Prefix of an expectation: floats have to be finite.
    const KIND: &'static str;

    /// False for NaN and infinities.
    fn is_finite(self) -> bool;
}

macro_rules! integers {
    ($($number:ty),*) => {$(
        impl Number for $number {
            const KIND: &'static str = "";

            fn is_finite(self) -> bool {
                true
            }
        }
    )*};
}

macro_rules! floats {
    ($($number:ty),*) => {$(
        impl Number for $number {
            const KIND: &'static str = "a finite number, ";

            fn is_finite(self) -> bool {
                <$number>::is_finite(self)
            }
        }
    )*};
}

integers!(u32, u64, usize);
floats!(f32, f64);

/// Fails unless `holds`; `expected` describes the permitted values.
///
/// # Errors
/// [`OutOfRange`] with these texts.
pub(crate) fn require(
    holds: bool,
    key: &'static str,
    found: impl Display,
    expected: impl Into<String>,
) -> Result<(), OutOfRange> {
    if holds {
        return Ok(());
    }
    Err(OutOfRange { key, found: found.to_string(), expected: expected.into() })
}

/// `value >= least`.
///
/// # Errors
/// [`OutOfRange`] if it is smaller, NaN or infinite.
pub(crate) fn at_least<N: Number>(key: &'static str, value: N, least: N) -> Result<(), OutOfRange> {
    let expected = format!("{}at least {least}", N::KIND);
    require(value.is_finite() && value >= least, key, value, expected)
}

/// `value > bound`.
///
/// # Errors
/// [`OutOfRange`] if it is not greater, NaN or infinite.
pub(crate) fn above<N: Number>(key: &'static str, value: N, bound: N) -> Result<(), OutOfRange> {
    let expected = format!("{}more than {bound}", N::KIND);
    require(value.is_finite() && value > bound, key, value, expected)
}

/// `value` in `range`, both ends included.
///
/// # Errors
/// [`OutOfRange`] if it is outside or NaN.
pub(crate) fn within<N: Number>(
    key: &'static str,
    value: N,
    range: RangeInclusive<N>,
) -> Result<(), OutOfRange> {
    let expected = format!("{} to {}", range.start(), range.end());
    require(range.contains(&value), key, value, expected)
}

/// Table-driven tests of a config's `check`.
#[cfg(test)]
pub(crate) mod table {
    use super::OutOfRange;
    use serde::Serialize;
    use std::collections::BTreeSet;

    /// A key, a change of its value that is refused, and one that is permitted (negative control).
    pub(crate) type Case<C> = (&'static str, fn(&mut C), fn(&mut C));

    /// Asserts each case, and that each number of the section has one. Only keys in `any_value`
    /// may hold any number of their type.
    pub(crate) fn assert_checks<C: Default + Serialize>(
        section: &str,
        check: fn(&C) -> Result<(), OutOfRange>,
        cases: &[Case<C>],
        any_value: &[&str],
    ) {
        let changed = |change: fn(&mut C)| {
            let mut config = C::default();
            change(&mut config);
            check(&config)
        };
        assert_eq!(changed(|_| {}), Ok(()), "the defaults of [{section}]");
        for (key, refuse, permit) in cases {
            let error = changed(*refuse).expect_err(key);
            assert_eq!(error.key, *key, "{error}");
            assert_eq!(changed(*permit), Ok(()), "{key}: the permitted change");
        }
        let defaults = toml::Table::try_from(C::default()).expect("configs are TOML tables");
        let mut numbers = BTreeSet::new();
        collect_numbers(section, &defaults, &mut numbers);
        for number in numbers {
            let has_case = cases.iter().any(|(key, ..)| *key == number);
            let is_any = any_value.contains(&number.as_str());
            assert!(has_case != is_any, "{number}: expected either a case or any value");
        }
    }

    /// Keys of all numbers and lists of numbers below `prefix`.
    fn collect_numbers(prefix: &str, table: &toml::Table, found: &mut BTreeSet<String>) {
        let is_number = |value: &toml::Value| value.is_integer() || value.is_float();
        for (key, value) in table {
            let key = format!("{prefix}.{key}");
            match value {
                toml::Value::Table(inner) => collect_numbers(&key, inner, found),
                toml::Value::Array(values) if values.iter().any(is_number) => {
                    found.insert(key);
                }
                value if is_number(value) => {
                    found.insert(key);
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_permitted_and_what_lies_beyond_is_refused() {
        assert_eq!(at_least("a.b", 1_usize, 1), Ok(()));
        assert!(at_least("a.b", 0_usize, 1).is_err());
        assert_eq!(above("a.b", 1e-9_f64, 0.0), Ok(()));
        assert!(above("a.b", 0.0_f64, 0.0).is_err());
        assert!([0.0_f32, 1.0].iter().all(|&value| within("a.b", value, 0.0..=1.0).is_ok()));
        assert!([-0.1_f32, 1.1].iter().all(|&value| within("a.b", value, 0.0..=1.0).is_err()));
    }

    #[test]
    fn nan_and_infinities_are_refused() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(at_least("a.b", value, 0.0).is_err(), "{value}");
            assert!(above("a.b", value, 0.0).is_err(), "{value}");
            assert!(within("a.b", value, 0.0..=1.0).is_err(), "{value}");
        }
    }

    #[test]
    fn an_error_names_key_value_and_range() {
        let text = |result: Result<(), OutOfRange>| result.unwrap_err().to_string();
        assert_eq!(text(at_least("a.b", 0_u32, 1)), "a.b is 0: expected at least 1");
        assert_eq!(text(within("a.b", 1.5_f32, 0.0..=1.0)), "a.b is 1.5: expected 0 to 1");
        let infinite = text(above("a.b", f64::INFINITY, 0.0));
        assert_eq!(infinite, "a.b is inf: expected a finite number, more than 0");
    }
}
