//! NumPy's `.npy`, version 1.0: float32 (little-endian) or uint8, C order.

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
/// The data begin at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

/// `values` as an array of `shape`, whose product is their number.
pub fn npy(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let mut out = header("<f4", shape, values.len());
    out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    out
}

/// The same of bytes.
pub fn npy_bytes(shape: &[usize], values: &[u8]) -> Vec<u8> {
    let mut out = header("|u1", shape, values.len());
    out.extend(values);
    out
}

fn header(kind: &str, shape: &[usize], count: usize) -> Vec<u8> {
    assert_eq!(shape.iter().product::<usize>(), count, "npy: shape against values");
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    // Python writes a tuple of one with a comma.
    let sides = sides.join(", ") + if shape.len() == 1 { "," } else { "" };
    let description =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}");
    // Magic, two bytes of length, description, spaces, a line feed.
    let unpadded = MAGIC.len() + 2 + description.len() + 1;
    let header_bytes = unpadded.next_multiple_of(ALIGNMENT) - MAGIC.len() - 2;
    let length = u16::try_from(header_bytes).expect("a shape of a few sides is short");
    let mut out = Vec::with_capacity(MAGIC.len() + 2 + header_bytes + count * 4);
    out.extend(MAGIC);
    out.extend(length.to_le_bytes());
    out.extend(format!("{description:<width$}\n", width = header_bytes - 1).into_bytes());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_and_data_are_where_numpy_looks() {
        let file = npy(&[2, 3], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.5]);
        assert_eq!(&file[..8], MAGIC);
        let header_bytes = usize::from(u16::from_le_bytes([file[8], file[9]]));
        assert_eq!((10 + header_bytes) % ALIGNMENT, 0);
        let header = std::str::from_utf8(&file[10..10 + header_bytes]).unwrap();
        assert!(
            header.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }"),
            "{header}"
        );
        assert!(header.ends_with('\n'));
        assert_eq!(&file[10 + header_bytes..][20..], 5.5_f32.to_le_bytes());
        let file = npy_bytes(&[3], &[7, 8, 9]);
        assert!(
            String::from_utf8_lossy(&file).contains("'descr': '|u1'") && file.ends_with(&[7, 8, 9])
        );
    }

    #[test]
    #[should_panic(expected = "npy: shape against values")]
    fn a_shape_that_disagrees_is_a_mistake() {
        npy(&[2, 2], &[0.0; 3]);
    }
}
