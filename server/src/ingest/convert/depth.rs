//! Depth images: 16-bit PNG, raw 16 bit, zstd of it, or metres -> `[height * width]` metres.
//!
//! What is out of range becomes 0, "no measurement". A frame whose measurements are nearly all out
//! of range has a wrong unit, and is refused.

use super::{Limits, Opening, Refusal, color};
use image::{DynamicImage, ImageFormat, ImageReader};
use lexsplat_proto::v1;
use std::io::{Cursor, Read as _};

const FIELD: &str = "depth";
/// Less than this share of the measurements in range: the unit is wrong.
const LEAST_SHARE_IN_RANGE: f64 = 0.01;
/// The largest window a zstd stream may ask for: 2^this bytes.
const ZSTD_WINDOW_LOG_MAX: u32 = 27;

/// Decodes a depth image of exactly the intrinsics' size.
pub(super) fn decode(
    wire: &v1::Frame,
    opening: &Opening,
    limits: &Limits,
) -> Result<Vec<f32>, Refusal> {
    let (width, height) = (opening.intrinsics.width, opening.intrinsics.height);
    let pixels = width as usize * height as usize;
    let unit = || {
        opening.depth_unit_metres.ok_or_else(|| {
            Refusal::new(
                "depth_format",
                "16-bit depth, but the stream was opened without depth_unit_metres",
            )
        })
    };
    let metres = match v1::DepthFormat::try_from(wire.depth_format) {
        Ok(v1::DepthFormat::Png16) => scaled(png16(&wire.depth, width, height)?, unit()?),
        Ok(v1::DepthFormat::U16) => scaled(u16s(FIELD, &wire.depth, pixels)?, unit()?),
        Ok(v1::DepthFormat::U16Zstd) => {
            scaled(u16s(FIELD, &unzstd(FIELD, &wire.depth, pixels * 2)?, pixels)?, unit()?)
        }
        Ok(v1::DepthFormat::F32Metres) => f32s(&wire.depth, pixels)?,
        Ok(v1::DepthFormat::Unspecified) | Err(_) => {
            let found = wire.depth_format;
            return Err(Refusal::new(
                "depth_format",
                format!(
                    "expected DEPTH_FORMAT_PNG16, _U16, _U16_ZSTD or _F32_METRES, found {found}"
                ),
            ));
        }
    };
    in_range(metres, limits)
}

fn png16(data: &[u8], width: u32, height: u32) -> Result<Vec<u16>, Refusal> {
    let bad = |error| Refusal::new(FIELD, format!("{} bytes are no PNG: {error}", data.len()));
    let reader = || ImageReader::with_format(Cursor::new(data), ImageFormat::Png);
    let found = reader().into_dimensions().map_err(bad)?;
    color::same_size(FIELD, found, (width, height))?;
    let mut reader = reader();
    reader.limits(color::decoder_limits(width, height));
    match reader.decode().map_err(bad)? {
        DynamicImage::ImageLuma16(image) => Ok(image.into_raw()),
        other => Err(Refusal::new(
            FIELD,
            format!("expected a 16-bit grey PNG, found {:?}", other.color()),
        )),
    }
}

pub(super) fn u16s(field: &str, data: &[u8], pixels: usize) -> Result<Vec<u16>, Refusal> {
    length(field, data, pixels, 2)?;
    Ok(data.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect())
}

fn f32s(data: &[u8], pixels: usize) -> Result<Vec<f32>, Refusal> {
    length(FIELD, data, pixels, 4)?;
    Ok(data
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]))
        .collect())
}

fn length(field: &str, data: &[u8], pixels: usize, bytes_per_pixel: usize) -> Result<(), Refusal> {
    let expected = pixels * bytes_per_pixel;
    if data.len() == expected {
        return Ok(());
    }
    Err(Refusal::new(
        field,
        format!(
            "expected {expected} bytes for the intrinsics' {pixels} pixels, found {}",
            data.len()
        ),
    ))
}

/// Unpacks at most one byte more than expected, whatever the stream claims.
pub(super) fn unzstd(field: &str, data: &[u8], expected: usize) -> Result<Vec<u8>, Refusal> {
    let bad = |error| Refusal::new(field, format!("{} bytes are no zstd: {error}", data.len()));
    let mut decoder = zstd::Decoder::new(data).map_err(bad)?;
    decoder.window_log_max(ZSTD_WINDOW_LOG_MAX).map_err(bad)?;
    let mut unpacked = Vec::with_capacity(expected);
    decoder.take(expected as u64 + 1).read_to_end(&mut unpacked).map_err(bad)?;
    if unpacked.len() > expected {
        return Err(Refusal::new(
            field,
            format!("unpacks to more than the expected {expected} bytes"),
        ));
    }
    Ok(unpacked)
}

fn scaled(units: Vec<u16>, unit_metres: f64) -> Vec<f32> {
    units.into_iter().map(|units| (f64::from(units) * unit_metres) as f32).collect()
}

/// Zeroes what is out of range; refuses when that is nearly all that was measured.
fn in_range(mut metres: Vec<f32>, limits: &Limits) -> Result<Vec<f32>, Refusal> {
    let range = limits.min_depth_metres..=limits.max_depth_metres;
    let (mut measured, mut kept, mut example) = (0_usize, 0_usize, 0.0);
    for depth in &mut metres {
        // 0, negative, NaN and infinite are "no measurement" on the wire already.
        if !(*depth > 0.0 && depth.is_finite()) {
            *depth = 0.0;
            continue;
        }
        measured += 1;
        if range.contains(depth) {
            kept += 1;
        } else {
            example = *depth;
            *depth = 0.0;
        }
    }
    if (kept as f64) < LEAST_SHARE_IN_RANGE * measured as f64 {
        let (near, far) = (range.start(), range.end());
        return Err(Refusal::new(
            FIELD,
            format!(
                "{kept} of {measured} depths are within {near} to {far} metres, others for example \
                 {example}: is depth_unit_metres right?"
            ),
        ));
    }
    Ok(metres)
}
