//! Text of data sets as people's programs write it: numpy, evo, spreadsheets, MSVC, Notepad, PowerShell.
//!
//! In: bytes of a file. Out: text, lines, numbers and times. What cannot be read is an error in words; which
//! file it was is the caller's to say.

use serde::de::{Deserialize as _, Deserializer, Error as _};

/// Text of UTF-8 or UTF-16 with a byte order mark, of UTF-8 without one, or else of Latin-1. Its lines end
/// with a line feed.
pub(super) fn decoded(bytes: &[u8]) -> String {
    let text = match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => utf8_or_latin1(rest),
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        _ => utf8_or_latin1(bytes),
    };
    match text.contains('\r') {
        true => text.replace("\r\n", "\n").replace('\r', "\n"),
        false => text,
    }
}

fn utf8_or_latin1(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        // The first 256 code points are those of Latin-1.
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
    }
}

fn utf16(bytes: &[u8], number: fn([u8; 2]) -> u16) -> String {
    let units = bytes.chunks_exact(2).map(|pair| number([pair[0], pair[1]]));
    char::decode_utf16(units).map(|unit| unit.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// A number for people: `525`, `319.5`, `1e300`.
pub fn shown(number: f64) -> String {
    let written = format!("{number:?}");
    written.strip_suffix(".0").map_or(written.clone(), str::to_owned)
}

/// Lines that are neither empty nor comments, with their numbers from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Whether a character stands between two values of a line.
fn is_separator(character: char) -> bool {
    character.is_whitespace() || matches!(character, ',' | ';')
}

/// The values of a line, separated by white space, commas or semicolons.
pub(super) fn words(line: &str) -> impl Iterator<Item = &str> {
    line.split(is_separator).filter(|word| !word.is_empty())
}

/// The first value of a line, and the rest of the line.
pub(super) fn first_word(line: &str) -> (&str, &str) {
    let (first, rest) = line.split_once(is_separator).unwrap_or((line, ""));
    (first, rest.trim_start_matches(is_separator).trim_end())
}

/// `N` numbers. What stands for no number, in any program's words, is NaN.
pub(super) fn numbers<const N: usize>(line: &str) -> Result<[f64; N], String> {
    let parse =
        |word| number(word).ok_or_else(|| format!("expected a number, found {}", quoted(word)));
    let parsed: Vec<f64> = words(line).map(parse).collect::<Result<_, _>>()?;
    let found = parsed.len();
    parsed.try_into().map_err(|_| format!("expected {N} numbers, found {found}"))
}

/// A number, also NaN and infinity as C's libraries print them: `nan`, `-nan(ind)`, `1.#IND`, `-1.#INF`.
fn number(word: &str) -> Option<f64> {
    let word = word.trim_matches('"');
    word.parse().ok().or_else(|| {
        let lower = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
        let is_none = lower.starts_with("nan(") || lower.starts_with("1.#");
        is_none.then_some(f64::NAN)
    })
}

/// Nanoseconds of decimal seconds, with or without an exponent, exactly: an `f64` cannot hold microseconds
/// since 1970. Digits behind the ninth place are cut.
pub(super) fn nanos(seconds: &str) -> Result<u64, String> {
    exact_nanos(seconds.trim_matches('"'))
        .ok_or_else(|| format!("expected seconds, found {}", quoted(seconds)))
}

fn exact_nanos(seconds: &str) -> Option<u64> {
    /// More digits than a time has, fewer than a `u64` overflows with.
    const EXPONENTS: std::ops::RangeInclusive<i64> = -60..=20;
    let (mantissa, exponent) = match seconds.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i64>().ok()?),
        None => (seconds, 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = format!("{whole}{fraction}");
    let is_number = !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
    if !is_number || !EXPONENTS.contains(&exponent) {
        return None;
    }
    // The place of the point in a count of nanoseconds, from the first digit.
    let point = usize::try_from(whole.len() as i64 + exponent + 9).unwrap_or(0);
    let kept = format!("{:0<point$}", &digits[..point.min(digits.len())]);
    if kept.is_empty() { Some(0) } else { kept.parse().ok() }
}

/// A word for an error, cut to a readable length.
fn quoted(word: &str) -> String {
    let cut: String = word.chars().take(40).collect();
    format!("{cut:?}")
}

/// A whole number in JSON, also as some programs write it: `150.0`.
pub(super) fn whole_number<'de, D: Deserializer<'de>, T: TryFrom<u64>>(
    source: D,
) -> Result<T, D::Error> {
    let value = f64::deserialize(source)?;
    let is_whole = value.fract() == 0.0 && (0.0..=9e15).contains(&value);
    let whole = is_whole.then_some(value as u64).and_then(|whole| T::try_from(whole).ok());
    whole
        .ok_or_else(|| D::Error::custom(format!("expected a whole number in range, found {value}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_every_encoding_is_read() {
        let utf16 = |mark: [u8; 2], bytes: fn(u16) -> [u8; 2]| {
            let units = "1 Küche\r\n2".encode_utf16().flat_map(bytes);
            mark.into_iter().chain(units).collect::<Vec<u8>>()
        };
        for bytes in [
            "1 Küche\n2".as_bytes().to_vec(),
            "\u{feff}1 Küche\r\n2".as_bytes().to_vec(),
            b"1 K\xfcche\r2".to_vec(),
            utf16([0xff, 0xfe], u16::to_le_bytes),
            utf16([0xfe, 0xff], u16::to_be_bytes),
        ] {
            assert_eq!(decoded(&bytes), "1 Küche\n2", "{bytes:x?}");
        }
        // Negative control: bytes that are no text become other text, and no panic.
        assert_ne!(decoded(b"\xff\xfe1"), "1");
    }

    #[test]
    fn numbers_are_read_as_programs_print_them() {
        assert_eq!(numbers::<3>("1e0, -2.5;\t+3").unwrap(), [1.0, -2.5, 3.0]);
        let none = "nan -nan(ind) 1.#IND -1.#INF 1.#QNAN NaN -1.#J nan(snan)";
        assert!(numbers::<8>(none).unwrap().iter().all(|number| number.is_nan()));
        assert_eq!(numbers::<2>("inf -inf").unwrap(), [f64::INFINITY, f64::NEG_INFINITY]);
        for (line, error) in [
            ("1 x", "expected a number, found \"x\""),
            ("1 #IND", "expected a number, found \"#IND\""),
            ("1", "expected 2 numbers, found 1"),
            // A decimal comma is not guessed at.
            ("1,5 2,5", "expected 2 numbers, found 4"),
        ] {
            assert_eq!(numbers::<2>(line).unwrap_err(), error);
        }
    }

    #[test]
    fn times_are_exact() {
        for (text, expected) in [
            ("1700000000.033333", 1_700_000_000_033_333_000),
            ("1.700000000033333063e+09", 1_700_000_000_033_333_063),
            ("17000000000333.33E-4", 1_700_000_000_033_333_000),
            ("0", 0),
            (".5", 500_000_000),
            ("7.", 7_000_000_000),
            ("0.0000000019", 1),
            ("1e-12", 0),
            ("1e2", 100_000_000_000),
        ] {
            assert_eq!(nanos(text), Ok(expected), "{text}");
        }
        for wrong in ["", ".", "soon", "-1", "1e", "1e99", "1.2.3", "99999999999", "1.5x", "nan"] {
            assert!(nanos(wrong).unwrap_err().starts_with("expected seconds, found"), "{wrong}");
        }
    }

    #[test]
    fn whole_numbers_may_have_a_point() {
        let read =
            |text: &str| whole_number::<_, u16>(&mut serde_json::Deserializer::from_str(text));
        assert_eq!((read("150").unwrap(), read("150.0").unwrap()), (150, 150));
        for wrong in ["150.5", "-1", "70000", "1e300", "\"150\""] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
