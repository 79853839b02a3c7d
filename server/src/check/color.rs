//! Color images: JPEG, PNG or raw RGB -> `[height * width * 3]`, 8 bit.
//!
//! Sizes are read from the headers and checked before pixels are decoded.

use super::images;
use super::refusal::Refusal;
use crate::pipeline::frame::Intrinsics;
use image::ImageFormat;
use lexsplat_proto::v1::ColorFormat;

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
    Ok(images::decode(FIELD, format, data, camera)?.into_rgb8().into_raw())
}
