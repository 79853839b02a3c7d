//! NumPy's `.npy`, version 1.0, little-endian, C order; the `npyz` crate writes it.

use npyz::{AutoSerialize, WriteOptions, WriterBuilder as _};

/// `values` as a file with an array of `shape`, the last axis running fastest.
///
/// # Panics
/// If the product of `shape` is not the number of values.
pub fn npy<T: AutoSerialize + Copy>(shape: &[usize], values: &[T]) -> Vec<u8> {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "npy: shape against values");
    let shape: Vec<u64> = shape.iter().map(|&side| side as u64).collect();
    let mut file = Vec::with_capacity(size_of_val(values) + 128);
    let options = WriteOptions::new().default_dtype().shape(&shape).writer(&mut file);
    let mut writer = options.begin_nd().expect("a vector takes all bytes");
    writer.extend(values.iter().copied()).expect("a vector takes all bytes");
    writer.finish().expect("the shape was checked");
    file
}

#[cfg(test)]
mod tests {
    use super::*;
    use npyz::{NpyFile, Order};

    /// The data begin at a multiple of this many bytes, as NumPy writes it.
    const ALIGNMENT: usize = 64;

    #[test]
    fn header_and_data_are_where_numpy_looks() {
        let file = npy(&[2, 3], &[0.0_f32, 1.0, 2.0, 3.0, 4.0, 5.5]);
        assert_eq!(&file[..8], b"\x93NUMPY\x01\x00");
        let header_bytes = usize::from(u16::from_le_bytes([file[8], file[9]]));
        assert_eq!((10 + header_bytes) % ALIGNMENT, 0);
        let header = std::str::from_utf8(&file[10..10 + header_bytes]).unwrap();
        assert!(
            header.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, ), }"),
            "{header}"
        );
        assert!(header.ends_with('\n'));
        assert_eq!(file.len(), 10 + header_bytes + 6 * 4);
        assert_eq!(&file[10 + header_bytes..][20..], 5.5_f32.to_le_bytes());
    }

    #[test]
    fn shape_type_order_and_values_are_read_back() {
        let floats = npy(&[1, 3], &[0.5_f32, -2.0, f32::MAX]);
        let read = NpyFile::new(&floats[..]).unwrap();
        assert_eq!((read.shape(), read.order()), (&[1, 3][..], Order::C));
        assert_eq!(read.dtype().descr(), "'<f4'");
        assert_eq!(read.into_vec::<f32>().unwrap(), [0.5, -2.0, f32::MAX]);
        let bytes = npy(&[3], &[7_u8, 8, 9]);
        let read = NpyFile::new(&bytes[..]).unwrap();
        assert_eq!((read.shape(), read.dtype().descr().as_str()), (&[3][..], "'|u1'"));
        assert_eq!(read.into_vec::<u8>().unwrap(), [7, 8, 9]);
        // An empty array keeps its columns.
        let nothing = npy::<f32>(&[0, 4], &[]);
        assert_eq!(NpyFile::new(&nothing[..]).unwrap().shape(), [0, 4]);
    }

    #[test]
    #[should_panic(expected = "npy: shape against values")]
    fn a_shape_that_disagrees_is_a_mistake() {
        npy(&[2, 2], &[0.0_f32; 3]);
    }
}
