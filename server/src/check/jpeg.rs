//! One whole JPEG picture out of the bytes that a camera sends as one.
//!
//! In: bytes. Out: the bytes from the start marker to the end marker, with tables to decode them.
//!
//! - A decoder fills the missing part of a truncated picture with grey. So the markers are followed up to the
//!   end marker, and a picture without one is refused.
//! - Behind the end marker there may be anything: padding, a line end of a multipart stream, a phone's
//!   trailer, the rest of a longer picture in a driver's buffer. It is left out.
//! - Frames of a camera's MJPG stream leave out the Huffman tables: those of the standard are meant (ITU
//!   T.81, annex K.3). They are put in.

use std::borrow::Cow;

/// Second bytes of markers, after 0xff.
const START: u8 = 0xd8;
const END: u8 = 0xd9;
const SCAN: u8 = 0xda;
const HUFFMAN_TABLES: u8 = 0xc4;
/// Frames whose entropy coding is Huffman's.
const HUFFMAN_FRAMES: [u8; 6] = [0xc0, 0xc1, 0xc2, 0xc3, 0xc5, 0xc6];
/// Markers without a length: TEM, RST0 to RST7 and SOI.
const ALONE: [u8; 10] = [0x01, 0xd0, 0xd1, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, START];

/// The picture, or in words why it is none.
pub(super) fn whole(data: &[u8]) -> Result<Cow<'_, [u8]>, String> {
    if !data.starts_with(&[0xff, START]) {
        return Err(format!("not a JPEG ({} bytes): expected FF D8 first", data.len()));
    }
    let truncated =
        || format!("truncated: {} bytes of JPEG without an end-of-image marker", data.len());
    let (mut at, mut first_scan) = (2, None);
    let (mut has_tables, mut needs_tables) = (false, false);
    loop {
        let marker = next_marker(data, at).ok_or_else(truncated)?;
        let code = data[marker + 1];
        at = marker + 2;
        match code {
            END => break,
            _ if ALONE.contains(&code) => continue,
            SCAN => first_scan = first_scan.or(Some(marker)),
            HUFFMAN_TABLES => has_tables = true,
            _ => needs_tables |= HUFFMAN_FRAMES.contains(&code),
        }
        let length = data.get(at..at + 2).ok_or_else(truncated)?;
        at += usize::from(u16::from_be_bytes([length[0], length[1]])).max(2);
    }
    let picture = &data[..at];
    Ok(match first_scan {
        Some(scan) if needs_tables && !has_tables => {
            Cow::Owned([&picture[..scan], &standard_tables(), &picture[scan..]].concat())
        }
        _ => Cow::Borrowed(picture),
    })
}

/// Where the next marker is. Coded pixels before it have 0xff only with a zero behind, and markers may have
/// any number of 0xff in front.
fn next_marker(data: &[u8], from: usize) -> Option<usize> {
    let rest = data.get(from..)?;
    let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xff);
    rest.windows(2).position(is_marker).map(|at| from + at)
}

/// A segment with the four tables of the standard: DC and AC of luminance (0), then of chrominance (1).
fn standard_tables() -> Vec<u8> {
    let tables: [(u8, [u8; 16], &[u8]); 4] = [
        (0x00, DC_LUMINANCE, &DC_VALUES),
        (0x10, AC_LUMINANCE, &AC_LUMINANCE_VALUES),
        (0x01, DC_CHROMINANCE, &DC_VALUES),
        (0x11, AC_CHROMINANCE, &AC_CHROMINANCE_VALUES),
    ];
    let mut body = Vec::new();
    for (class_and_number, counts, values) in tables {
        body.push(class_and_number);
        body.extend(counts);
        body.extend(values);
    }
    let length = (body.len() + 2) as u16;
    [&[0xff, HUFFMAN_TABLES], &length.to_be_bytes()[..], &body].concat()
}

/// Numbers of codes of 1 to 16 bits.
const DC_LUMINANCE: [u8; 16] = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
const DC_CHROMINANCE: [u8; 16] = [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0];
const DC_VALUES: [u8; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
const AC_LUMINANCE: [u8; 16] = [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d];
const AC_CHROMINANCE: [u8; 16] = [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77];
#[rustfmt::skip]
const AC_LUMINANCE_VALUES: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
    0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72,
    0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37,
    0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
    0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
    0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3,
    0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
    0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];
#[rustfmt::skip]
const AC_CHROMINANCE_VALUES: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
    0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1,
    0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
    0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
    0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a,
    0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba,
    0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
    0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use image::{ImageFormat, RgbImage};

    fn encoded() -> Vec<u8> {
        let picture = RgbImage::from_fn(40, 24, |x, y| {
            image::Rgb([(x * 6) as u8, (y * 10) as u8, ((x * y) % 251) as u8])
        });
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 90).encode_image(&picture).unwrap();
        bytes
    }

    fn pixels(bytes: &[u8]) -> Option<Vec<u8>> {
        let decoded = image::load_from_memory_with_format(bytes, ImageFormat::Jpeg).ok()?;
        Some(decoded.into_rgb8().into_raw())
    }

    /// The picture without segments of this kind.
    fn without(bytes: &[u8], code: u8) -> Vec<u8> {
        let (mut kept, mut at) = (bytes[..2].to_vec(), 2);
        while bytes[at + 1] != SCAN {
            let end = at + 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
            if bytes[at + 1] != code {
                kept.extend(&bytes[at..end]);
            }
            at = end;
        }
        kept.extend(&bytes[at..]);
        kept
    }

    #[test]
    fn what_stands_behind_a_picture_is_left_out() {
        let plain = encoded();
        assert!(matches!(whole(&plain).unwrap(), Cow::Borrowed(_)));
        for behind in [
            &b"\0\0\0"[..],
            b"\n",
            b"\r\n",
            b"\xff\xff",
            b"\0\0\x12\x34",
            b"SEFT",
            b"\xff\xd8\xff\xe0",
        ] {
            let bytes = [&plain, behind].concat();
            assert_eq!(*whole(&bytes).unwrap(), plain[..], "{behind:?}");
        }
        // The thumbnail in the header has an end marker of its own, which is not the picture's.
        let thumbnail =
            [&[0xff, 0xe1][..], &((plain.len() + 2) as u16).to_be_bytes(), &plain].concat();
        let with_one = [&plain[..2], &thumbnail, &plain[2..]].concat();
        assert_eq!(*whole(&with_one).unwrap(), with_one[..]);
        assert!(whole(&with_one[..thumbnail.len() + 40]).is_err());
    }

    #[test]
    fn a_picture_that_was_cut_is_refused_wherever() {
        let plain = encoded();
        for length in 0..plain.len() {
            let error = whole(&plain[..length]).unwrap_err();
            assert!(error.contains("truncated") || length < 2, "{length}: {error}");
        }
        assert!(whole(&[&plain[..plain.len() / 2], &[0; 9][..]].concat()).is_err());
        assert!(whole(b"\x89PNG\r\n").unwrap_err().contains("not a JPEG"));
    }

    #[test]
    fn a_picture_without_tables_has_those_of_the_standard() {
        let plain = encoded();
        let bare = without(&plain, HUFFMAN_TABLES);
        assert!(
            bare.len() < plain.len() && pixels(&bare).is_none(),
            "no decoder shows it as it is"
        );
        let mended = whole(&bare).unwrap();
        // The encoder of this test uses the standard's tables.
        assert_eq!(pixels(&mended), pixels(&plain));
        assert!(pixels(&mended).is_some());
    }
}
