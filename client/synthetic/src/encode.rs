//! Pictures of a view as bytes: color as JPEG, depth as 16-bit PNG, instances as 8-bit PNG.

use crate::camera::View;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};

/// Depth units per metre of rendered rooms.
pub const DEPTH_SCALE: f64 = 6553.5;
const JPEG_QUALITY: u8 = 95;

/// The color image of a view as JPEG.
///
/// # Errors
/// If the encoder fails.
pub fn jpeg(view: &View) -> Result<Vec<u8>, ImageError> {
    rgb_jpeg(view.width, view.height, &view.rgb)
}

/// Bytes of sRGB, 3 per pixel, as JPEG.
pub(crate) fn rgb_jpeg(width: u32, height: u32, rgb: &[u8]) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).write_image(
        rgb,
        width,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

/// The depth of a view as 16-bit PNG, 6553.5 units per metre.
///
/// # Errors
/// If the encoder fails.
pub fn depth_png(view: &View) -> Result<Vec<u8>, ImageError> {
    let units = |d: &f32| (f64::from(*d) * DEPTH_SCALE).round().clamp(0.0, 65535.0) as u16;
    units_png(view.width, view.height, view.depth.iter().map(units))
}

/// 16-bit samples as grey PNG.
pub(crate) fn units_png(
    width: u32,
    height: u32,
    units: impl Iterator<Item = u16>,
) -> Result<Vec<u8>, ImageError> {
    // The encoder takes samples in native byte order.
    let samples: Vec<u8> = units.flat_map(u16::to_ne_bytes).collect();
    png(width, height, &samples, ExtendedColorType::L16)
}

/// The instance ids of a view as 8-bit PNG.
///
/// # Errors
/// If the encoder fails.
pub fn mask_png(view: &View) -> Result<Vec<u8>, ImageError> {
    ids_png(view.width, view.height, &view.instances)
}

/// 8-bit samples as grey PNG.
pub(crate) fn ids_png(width: u32, height: u32, ids: &[u8]) -> Result<Vec<u8>, ImageError> {
    png(width, height, ids, ExtendedColorType::L8)
}

fn png(
    width: u32,
    height: u32,
    samples: &[u8],
    kind: ExtendedColorType,
) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(samples, width, height, kind)?;
    Ok(bytes)
}
