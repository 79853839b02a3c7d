//! Color images: JPEG, PNG or raw RGB -> `[height * width * 3]`, 8 bit.
//!
//! Sizes are read from the headers and checked before anything is decoded.

use super::images::{self, decoder_limits};
use super::refusal::Refusal;
use crate::pipeline::frame::Intrinsics;
use image::{ImageFormat, ImageReader};
use lexsplat_proto::v1::ColorFormat;
use std::io::Cursor;

const FIELD: &str = "color";
/// Every JPEG ends with this marker.
const JPEG_END: [u8; 2] = [0xff, 0xd9];

/// Decodes a color image of the camera's size.
pub(super) fn decode(format: i32, data: &[u8], camera: &Intrinsics) -> Result<Vec<u8>, Refusal> {
    match ColorFormat::try_from(format) {
        Ok(ColorFormat::Jpeg) => jpeg(data, camera),
        Ok(ColorFormat::Png) => compressed(ImageFormat::Png, data, camera),
        Ok(ColorFormat::Rgb8) => raw(data, camera),
        Ok(ColorFormat::Unspecified) | Err(_) => Err(Refusal::new(
            "color_format",
            format!("expected COLOR_FORMAT_JPEG, _PNG or _RGB8, found {format}"),
        )),
    }
}

fn raw(data: &[u8], camera: &Intrinsics) -> Result<Vec<u8>, Refusal> {
    let Intrinsics { width, height, .. } = camera;
    let expected = *width as usize * *height as usize * 3;
    if data.len() != expected {
        return Err(Refusal::new(
            FIELD,
            format!("expected {expected} bytes of RGB8 for {width}x{height}, found {}", data.len()),
        ));
    }
    Ok(data.to_vec())
}

fn jpeg(data: &[u8], camera: &Intrinsics) -> Result<Vec<u8>, Refusal> {
    // A decoder would fill the missing part of a truncated JPEG with grey. Some cameras pad
    // complete files with zeros.
    let padding = data.iter().rev().take_while(|byte| **byte == 0).count();
    if !data[..data.len() - padding].ends_with(&JPEG_END) {
        return Err(Refusal::new(
            FIELD,
            format!("truncated: {} bytes of JPEG without an end-of-image marker", data.len()),
        ));
    }
    compressed(ImageFormat::Jpeg, data, camera)
}

fn compressed(format: ImageFormat, data: &[u8], camera: &Intrinsics) -> Result<Vec<u8>, Refusal> {
    let name = format.extensions_str()[0].to_uppercase();
    let bad = |error| Refusal::new(FIELD, format!("not a {name} ({} bytes): {error}", data.len()));
    let found =
        ImageReader::with_format(Cursor::new(data), format).into_dimensions().map_err(bad)?;
    images::same_size(FIELD, found, camera)?;
    let mut reader = ImageReader::with_format(Cursor::new(data), format);
    reader.limits(decoder_limits(camera));
    Ok(reader.decode().map_err(bad)?.into_rgb8().into_raw())
}
