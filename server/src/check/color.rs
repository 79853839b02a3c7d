//! Color images: JPEG, PNG or raw RGB -> `[height * width * 3]`, 8 bit.
//!
//! Sizes are read from the headers and checked before pixels are decoded.

use super::images::{self, Size};
use super::jpeg;
use super::refusal::Refusal;
use image::ImageFormat;
use lexsplat_proto::v1::ColorFormat;

const FIELD: &str = "color";

/// Decodes a color image of the camera's size.
pub(super) fn decode(format: i32, data: &[u8], size: Size) -> Result<Vec<u8>, Refusal> {
    match ColorFormat::try_from(format) {
        Ok(ColorFormat::Jpeg) => jpeg_picture(data, size),
        Ok(ColorFormat::Png) => compressed(ImageFormat::Png, data, size),
        Ok(ColorFormat::Rgb8) => raw(data, size),
        Ok(ColorFormat::Unspecified) | Err(_) => Err(Refusal::new(
            "color_format",
            format!("expected COLOR_FORMAT_JPEG, _PNG or _RGB8, found {format}"),
        )),
    }
}

fn raw(data: &[u8], size: Size) -> Result<Vec<u8>, Refusal> {
    let (width, height) = size;
    let expected = width as usize * height as usize * 3;
    if data.len() != expected {
        return Err(Refusal::new(
            FIELD,
            format!("expected {expected} bytes of RGB8 for {width}x{height}, found {}", data.len()),
        ));
    }
    Ok(data.to_vec())
}

/// What stands behind the picture is left out, and standard tables are put in where the sender left them out.
fn jpeg_picture(data: &[u8], size: Size) -> Result<Vec<u8>, Refusal> {
    let whole = jpeg::whole(data).map_err(|reason| Refusal::new(FIELD, reason))?;
    compressed(ImageFormat::Jpeg, &whole, size)
}

fn compressed(format: ImageFormat, data: &[u8], size: Size) -> Result<Vec<u8>, Refusal> {
    Ok(images::decode(FIELD, format, data, size)?.into_rgb8().into_raw())
}
