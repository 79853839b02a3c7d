//! Reads NumPy's `.npy` as the server writes it: version 1.0, float32, little-endian, C order.
//! In: bytes. Out: a shape and that many values. Other kinds of arrays are refused.

/// Values with a shape, the last axis running fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of the axes.
    pub shape: Vec<usize>,
    /// As many as the product of the shape.
    pub values: Vec<f32>,
}

/// Why bytes are no such array.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("npy {field}: expected {expected}, found {found}")]
pub struct NpyError {
    field: &'static str,
    expected: String,
    found: String,
}

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
const LENGTH_BYTES: usize = 2;

/// Reads an array.
///
/// # Errors
/// [`NpyError`] names what is wrong.
pub fn read(file: &[u8]) -> Result<Array, NpyError> {
    let wrong = |field, expected: &str, found: String| {
        Err(NpyError { field, expected: expected.into(), found })
    };
    let start = MAGIC.len() + LENGTH_BYTES;
    let Some(rest) = file.get(start..).filter(|_| file.starts_with(MAGIC)) else {
        let first = &file[..file.len().min(MAGIC.len())];
        return wrong("magic", "a version 1.0 file", format!("{first:02x?}"));
    };
    let header_bytes = usize::from(u16::from_le_bytes([file[MAGIC.len()], file[MAGIC.len() + 1]]));
    let Some((header, data)) = rest.split_at_checked(header_bytes) else {
        return wrong("header", &format!("{header_bytes} bytes"), rest.len().to_string());
    };
    let header = String::from_utf8_lossy(header);
    for (field, expected) in [("descr", "'<f4'"), ("fortran_order", "False")] {
        if after(&header, field).is_none_or(|value| !value.starts_with(expected)) {
            return wrong(field, expected, header.trim().to_owned());
        }
    }
    let Some(shape) = after(&header, "shape").and_then(tuple) else {
        return wrong("shape", "a tuple of lengths", header.trim().to_owned());
    };
    let (values, spare) = data.as_chunks::<4>();
    let count = shape.iter().try_fold(1_usize, |product, side| product.checked_mul(*side));
    if count != Some(values.len()) || !spare.is_empty() {
        return wrong(
            "data",
            &format!("float32 of shape {shape:?}"),
            format!("{} bytes", data.len()),
        );
    }
    Ok(Array { shape, values: values.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect() })
}

/// What follows a key of the header.
fn after<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, value) = header.split_once(&format!("'{key}':"))?;
    Some(value.trim_start())
}

fn tuple(text: &str) -> Option<Vec<usize>> {
    let (inside, _) = text.strip_prefix('(')?.split_once(')')?;
    inside
        .split(',')
        .map(str::trim)
        .filter(|side| !side.is_empty())
        .map(|side| side.parse().ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [MAGIC, &length, header.as_bytes(), data].concat()
    }

    const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1, ), }   \n";

    #[test]
    fn shape_and_values_come_back() {
        let data = [0.5_f32.to_le_bytes(), (-2.0_f32).to_le_bytes()].concat();
        let array = read(&file(HEADER, &data)).unwrap();
        assert_eq!(array, Array { shape: vec![2, 1], values: vec![0.5, -2.0] });
    }

    #[test]
    fn other_files_are_refused_with_the_field() {
        let field = |bytes: &[u8]| read(bytes).map_err(|error| error.field).unwrap_err();
        assert_eq!(field(b""), "magic");
        assert_eq!(field(b"\x89PNG\r\n\x1a\n and more"), "magic");
        assert_eq!(field(&file(HEADER, &[])[..40]), "header");
        assert_eq!(field(&file(&HEADER.replace("<f4", "<f8"), &[0; 16])), "descr");
        assert_eq!(field(&file(&HEADER.replace("False", "True"), &[0; 8])), "fortran_order");
        assert_eq!(field(&file(&HEADER.replace("(2, 1, )", "(2, x)"), &[0; 8])), "shape");
        for bytes in [4, 7, 9, 12] {
            assert_eq!(field(&file(HEADER, &vec![0; bytes])), "data");
        }
    }
}
