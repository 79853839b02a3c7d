//! Depth images: 16-bit PNG, raw 16 bit, zstd of it, or metres -> `[height * width]` metres.
//!
//! Depths out of range become 0, "no measurement", and so do the values of [`Depths::none`] in the 16-bit
//! formats. If nearly all depths are out of range, the unit must be wrong, and the frame is refused.

use super::images::{self, Size, u16s, unzstd};
use super::opening::{Depths, Opening};
use super::refusal::Refusal;
use image::{DynamicImage, ImageFormat};
use lexsplat_proto::v1;

const FIELD: &str = "depth";
/// Share of the measurements that must be in range; below it the unit is assumed to be wrong.
const LEAST_SHARE_IN_RANGE: f64 = 0.01;

/// Decodes a depth image of the depth camera's size.
pub(super) fn decode(wire: &v1::Frame, opening: &Opening) -> Result<Vec<f32>, Refusal> {
    let size = opening.registration.cameras().depth_size();
    let pixels = size.0 as usize * size.1 as usize;
    let scaled = |units: Vec<u16>, unit_metres| scaled(units, unit_metres, &opening.depths.none);
    let unit = || {
        opening.depth_unit_metres.ok_or_else(|| {
            Refusal::new(
                "depth_format",
                "16-bit depth, but the stream was opened without depth_unit_metres",
            )
        })
    };
    let metres = match v1::DepthFormat::try_from(wire.depth_format) {
        Ok(v1::DepthFormat::Png16) => scaled(png16(&wire.depth, size)?, unit()?),
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
    in_range(metres, &opening.depths)
}

fn png16(data: &[u8], size: Size) -> Result<Vec<u16>, Refusal> {
    match images::decode(FIELD, ImageFormat::Png, data, size)? {
        DynamicImage::ImageLuma16(image) => Ok(image.into_raw()),
        other => Err(Refusal::new(
            FIELD,
            format!("expected a 16-bit grey PNG, found {:?}", other.color()),
        )),
    }
}

fn f32s(data: &[u8], pixels: usize) -> Result<Vec<f32>, Refusal> {
    images::length(FIELD, data, pixels, 4)?;
    Ok(data
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]))
        .collect())
}

/// Metres; 0 where nothing was measured.
fn scaled(units: Vec<u16>, unit_metres: f64, none: &[u16]) -> Vec<f32> {
    let metres = |units| {
        if none.contains(&units) { 0.0 } else { (f64::from(units) * unit_metres) as f32 }
    };
    units.into_iter().map(metres).collect()
}

/// Sets depths out of range to 0; refuses the frame if nearly all are out of range.
fn in_range(mut metres: Vec<f32>, depths: &Depths) -> Result<Vec<f32>, Refusal> {
    let [near, far] = depths.range_metres;
    let range = near..=far;
    let (mut measured, mut kept, mut example) = (0_usize, 0_usize, 0.0);
    for depth in &mut metres {
        // 0, negative, NaN and infinite mean "no measurement" on the wire.
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
