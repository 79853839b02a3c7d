//! NumPy's `.npy`, little-endian, C order: float32 in the server's answers, and depth as programs in
//! Python store it. The `npyz` crate reads them; arrays of other kinds are refused.

use npyz::{NpyFile, NpyHeader, Order};

/// Values with a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of the axes; the last one runs fastest.
    pub shape: Vec<usize>,
    /// As many values as the product of the shape.
    pub values: Vec<f32>,
}

/// Bytes that are not such an array.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The header cannot be read.
    #[error("npy header: {0}")]
    Header(std::io::Error),
    /// The array is of another kind.
    #[error("npy {field}: expected {expected}, found {found}")]
    Kind {
        /// Field of the header.
        field: &'static str,
        /// The only accepted value.
        expected: &'static str,
        /// The value in the file.
        found: String,
    },
    /// The data does not fit the shape.
    #[error("npy data: expected {kind} of shape {shape:?}, found {bytes} bytes")]
    Size {
        /// Kind of the values.
        kind: &'static str,
        /// Shape in the header.
        shape: Vec<u64>,
        /// Bytes after the header.
        bytes: usize,
    },
}

const FLOAT32: &str = "'<f4'";
const FLOAT64: &str = "'<f8'";
const UINT16: &str = "'<u2'";

/// Reads an array of float32.
///
/// # Errors
/// [`NpyError`] if the bytes are not such an array.
pub fn read(file: &[u8]) -> Result<Array, NpyError> {
    let found = header(file)?.dtype().descr();
    match found == FLOAT32 {
        true => array::<f32>(file, "float32", |value| value),
        false => Err(NpyError::Kind { field: "descr", expected: FLOAT32, found }),
    }
}

/// Reads an array of float32, float64 or uint16.
///
/// # Errors
/// [`NpyError`] if the bytes are not such an array.
pub(crate) fn read_numbers(file: &[u8]) -> Result<Array, NpyError> {
    let found = header(file)?.dtype().descr();
    match &*found {
        FLOAT32 => array::<f32>(file, "float32", |value| value),
        FLOAT64 => array::<f64>(file, "float64", |value| value as f32),
        UINT16 => array::<u16>(file, "uint16", f32::from),
        _ => {
            let expected = "'<f4', '<f8' or '<u2'";
            Err(NpyError::Kind { field: "descr", expected, found })
        }
    }
}

fn header(mut file: &[u8]) -> Result<NpyHeader, NpyError> {
    NpyHeader::from_reader(&mut file).map_err(NpyError::Header)
}

/// The values of a file, whose type is `T`.
fn array<T: npyz::Deserialize>(
    file: &[u8],
    kind: &'static str,
    convert: fn(T) -> f32,
) -> Result<Array, NpyError> {
    let mut data = file;
    let header = NpyHeader::from_reader(&mut data).map_err(NpyError::Header)?;
    if header.order() != Order::C {
        let (field, expected) = ("fortran_order", "False");
        return Err(NpyError::Kind { field, expected, found: "True".into() });
    }
    let shape = header.shape().to_vec();
    let wrong_size = || NpyError::Size { kind, shape: shape.clone(), bytes: data.len() };
    let sides = shape.iter().map(|side| usize::try_from(*side).ok());
    let sides: Vec<usize> = sides.collect::<Option<_>>().ok_or_else(wrong_size)?;
    let bytes = sides.iter().try_fold(size_of::<T>(), |product, side| product.checked_mul(*side));
    if bytes != Some(data.len()) {
        return Err(wrong_size());
    }
    let values = NpyFile::with_header(header, data).into_vec().map_err(NpyError::Header)?;
    Ok(Array { shape: sides, values: values.into_iter().map(convert).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
    }

    const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1, ), }   \n";

    #[test]
    fn shape_and_values_come_back() {
        let data = [0.5_f32.to_le_bytes(), (-2.0_f32).to_le_bytes()].concat();
        let array = read(&file(HEADER, &data)).unwrap();
        assert_eq!(array, Array { shape: vec![2, 1], values: vec![0.5, -2.0] });
    }

    #[test]
    fn depth_of_other_kinds_is_read() {
        let doubles = [0.25_f64.to_le_bytes(), f64::INFINITY.to_le_bytes()].concat();
        let array = read_numbers(&file(&HEADER.replace("<f4", "<f8"), &doubles)).unwrap();
        assert_eq!(array.values, [0.25, f32::INFINITY]);
        let units = [7_u16.to_le_bytes(), 65535_u16.to_le_bytes()].concat();
        let array = read_numbers(&file(&HEADER.replace("<f4", "<u2"), &units)).unwrap();
        assert_eq!((array.values, array.shape), (vec![7.0, 65535.0], vec![2, 1]));
        let error = read_numbers(&file(&HEADER.replace("<f4", "<i8"), &[0; 16])).unwrap_err();
        assert_eq!(
            error.to_string(),
            "npy descr: expected '<f4', '<f8' or '<u2', found '<i8'",
            "control"
        );
    }

    #[test]
    fn other_files_are_refused_with_the_field_at_fault() {
        let error = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
        for bytes in [&b""[..], b"\x89PNG\r\n\x1a\n and more", &file(HEADER, &[])[..40]] {
            assert!(error(bytes).starts_with("npy header: "), "{}", error(bytes));
        }
        let shape = file(&HEADER.replace("(2, 1, )", "(2, x)"), &[0; 8]);
        assert!(error(&shape).starts_with("npy header: "), "{}", error(&shape));
        let descr = file(&HEADER.replace("<f4", "<f8"), &[0; 16]);
        assert_eq!(error(&descr), "npy descr: expected '<f4', found '<f8'");
        let order = file(&HEADER.replace("False", "True"), &[0; 8]);
        assert_eq!(error(&order), "npy fortran_order: expected False, found True");
        for bytes in [4, 7, 9, 12] {
            let error = error(&file(HEADER, &vec![0; bytes]));
            let expected =
                format!("npy data: expected float32 of shape [2, 1], found {bytes} bytes");
            assert_eq!(error, expected);
        }
    }
}
