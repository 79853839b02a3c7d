//! Color images: JPEG, PNG or raw RGB -> `[height * width * 3]`, 8 bit.
//!
//! Sizes are read from the headers and checked before anything is decoded.

use super::Refusal;
use image::{ImageFormat, ImageReader, Limits};
use lexsplat_proto::v1::ColorFormat;
use std::io::Cursor;

const FIELD: &str = "color";
/// Every JPEG ends with this marker.
const JPEG_END: [u8; 2] = [0xff, 0xd9];

/// Decodes a color image of exactly `width` x `height`.
pub(super) fn decode(
    format: i32,
    data: &[u8],
    width: u32,
    height: u32,
) -> Result<Vec<u8>, Refusal> {
    match ColorFormat::try_from(format) {
        Ok(ColorFormat::Jpeg) => jpeg(data, width, height),
        Ok(ColorFormat::Png) => compressed(ImageFormat::Png, data, width, height),
        Ok(ColorFormat::Rgb8) => raw(data, width, height),
        Ok(ColorFormat::Unspecified) | Err(_) => Err(Refusal::new(
            "color_format",
            format!("expected COLOR_FORMAT_JPEG, _PNG or _RGB8, found {format}"),
        )),
    }
}

fn raw(data: &[u8], width: u32, height: u32) -> Result<Vec<u8>, Refusal> {
    let expected = width as usize * height as usize * 3;
    if data.len() != expected {
        return Err(Refusal::new(
            FIELD,
            format!("expected {expected} bytes of RGB8 for {width}x{height}, found {}", data.len()),
        ));
    }
    Ok(data.to_vec())
}

fn jpeg(data: &[u8], width: u32, height: u32) -> Result<Vec<u8>, Refusal> {
    // Decoders fill what a cut JPEG lacks with grey; cameras pad whole ones with zeros.
    let padding = data.iter().rev().take_while(|byte| **byte == 0).count();
    if !data[..data.len() - padding].ends_with(&JPEG_END) {
        return Err(Refusal::new(
            FIELD,
            format!(
                "{} bytes of JPEG do not end with the end-of-image marker: truncated",
                data.len()
            ),
        ));
    }
    compressed(ImageFormat::Jpeg, data, width, height)
}

fn compressed(
    format: ImageFormat,
    data: &[u8],
    width: u32,
    height: u32,
) -> Result<Vec<u8>, Refusal> {
    let name = format.extensions_str()[0].to_uppercase();
    let bad = |error| Refusal::new(FIELD, format!("{} bytes are no {name}: {error}", data.len()));
    let found =
        ImageReader::with_format(Cursor::new(data), format).into_dimensions().map_err(bad)?;
    same_size(FIELD, found, (width, height))?;
    let mut reader = ImageReader::with_format(Cursor::new(data), format);
    reader.limits(decoder_limits(width, height));
    Ok(reader.decode().map_err(bad)?.into_rgb8().into_raw())
}

/// What a decoder may take for an image of this size.
pub(super) fn decoder_limits(width: u32, height: u32) -> Limits {
    // 16 bit RGBA is the widest pixel; twice for the decoder's own buffers; a floor for tables.
    const BYTES_PER_PIXEL: u64 = 8 * 2;
    const FLOOR_BYTES: u64 = 1 << 20;
    let mut limits = Limits::default();
    limits.max_image_width = Some(width);
    limits.max_image_height = Some(height);
    limits.max_alloc = Some(u64::from(width) * u64::from(height) * BYTES_PER_PIXEL + FLOOR_BYTES);
    limits
}

/// Checks that an image is of the size that the intrinsics say.
pub(super) fn same_size(
    field: &str,
    (width, height): (u32, u32),
    (expected_width, expected_height): (u32, u32),
) -> Result<(), Refusal> {
    if (width, height) == (expected_width, expected_height) {
        return Ok(());
    }
    Err(Refusal::new(
        field,
        format!(
            "expected {expected_width}x{expected_height} as in the intrinsics, found {width}x{height}"
        ),
    ))
}
