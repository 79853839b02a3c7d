//! Depth of ROS's `compressed_depth_image_transport`: a header of 12 bytes (i32 format, two f32 parameters),
//! then a 16-bit PNG, or columns and rows (u32) and RVL. Metres are quantised: `A / (q - B)` with the two
//! parameters, 0 is no measurement.

use super::error::MessageError;
use super::{encoded, rvl};
use crate::dataset::{Depth, DepthFormat};

/// Bytes of the header.
const HEADER: usize = 12;
/// The most pixels that a picture may have; the server takes fewer.
const MOST_PIXELS: u64 = 1 << 27;

/// Compressed depth in its parts.
struct Parts<'a> {
    parameters: [f32; 2],
    is_metres: bool,
    is_rvl: bool,
    body: &'a [u8],
}

impl<'a> Parts<'a> {
    /// `format` as in `16UC1; compressedDepth png`.
    fn of(format: &str, data: &'a [u8]) -> Result<Self, MessageError> {
        let (is_metres, is_rvl) = (format.starts_with("32FC1"), format.contains("rvl"));
        // Some senders leave the header out.
        if encoded::png_kind(data).is_some() && !is_metres {
            return Ok(Self { parameters: [0.0; 2], is_metres, is_rvl: false, body: data });
        }
        let (header, body) = data.split_at_checked(HEADER).ok_or_else(short)?;
        let number = |at: usize| f32::from_le_bytes(std::array::from_fn(|byte| header[at + byte]));
        Ok(Self { parameters: [number(4), number(8)], is_metres, is_rvl, body })
    }

    /// Columns, rows and the code behind them.
    fn rvl(&self) -> Result<(u32, u32, &'a [u8]), MessageError> {
        let (sizes, code) = self.body.split_at_checked(8).ok_or_else(short)?;
        let number = |at: usize| u32::from_le_bytes(std::array::from_fn(|byte| sizes[at + byte]));
        let (width, height) = (number(0), number(4));
        if u64::from(width) * u64::from(height) > MOST_PIXELS {
            let reason = format!("expected a picture, found {width}x{height} pixels");
            return Err(MessageError::content(reason));
        }
        Ok((width, height, code))
    }

    fn units(&self) -> Result<Vec<u16>, MessageError> {
        if self.is_rvl {
            let (width, height, code) = self.rvl()?;
            let units = rvl::decoded(code, width as usize * height as usize);
            return units.ok_or_else(|| MessageError::content("expected whole RVL"));
        }
        let decoded = image::load_from_memory_with_format(self.body, image::ImageFormat::Png);
        match decoded {
            Ok(image::DynamicImage::ImageLuma16(units)) => Ok(units.into_raw()),
            Ok(other) => {
                let found = other.color();
                Err(MessageError::content(format!("expected 16-bit grey, found {found:?}")))
            }
            Err(error) => Err(MessageError::content(format!("expected a PNG: {error}"))),
        }
    }
}

fn short() -> MessageError {
    MessageError::content("expected compressed depth, found an unexpected end")
}

/// Columns and rows.
pub(super) fn size(format: &str, data: &[u8]) -> Result<(u32, u32), MessageError> {
    let parts = Parts::of(format, data)?;
    match parts.is_rvl {
        true => parts.rvl().map(|(width, height, _)| (width, height)),
        false => encoded::size(parts.body),
    }
}

/// Depth in millimetres or metres.
pub(super) fn depth(format: &str, data: &[u8]) -> Result<Depth, MessageError> {
    let parts = Parts::of(format, data)?;
    if parts.is_metres {
        let [a, b] = parts.parameters;
        let metres = |units: u16| if units == 0 { f32::NAN } else { a / (f32::from(units) - b) };
        let bytes = parts.units()?.into_iter().flat_map(|units| metres(units).to_le_bytes());
        return Ok(Depth { format: DepthFormat::F32Metres, bytes: bytes.collect() });
    }
    if !parts.is_rvl {
        return Ok(Depth { format: DepthFormat::Png16, bytes: parts.body.to_vec() });
    }
    let bytes = parts.units()?.into_iter().flat_map(u16::to_le_bytes).collect();
    Ok(Depth { format: DepthFormat::U16, bytes })
}
