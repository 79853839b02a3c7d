//! Decoding shared by color, depth and label images.

use super::refusal::Refusal;
use image::{DynamicImage, ImageDecoder as _, ImageFormat, ImageReader, Limits};
use std::io::{Cursor, Read as _};

/// The largest window that a zstd stream may ask for: 2^this bytes.
const ZSTD_WINDOW_LOG_MAX: u32 = 27;

/// Columns and rows.
pub(super) type Size = (u32, u32);

/// Decodes a PNG or JPEG of the camera's size. Its header is checked before pixels are decoded, and all that
/// stands in the file (profiles, texts) is decoded within the memory of an image of that size.
pub(super) fn decode(
    field: &str,
    format: ImageFormat,
    data: &[u8],
    size: Size,
) -> Result<DynamicImage, Refusal> {
    let name = format.extensions_str()[0].to_uppercase();
    let bad = |error| Refusal::new(field, format!("not a {name} ({} bytes): {error}", data.len()));
    let mut reader = ImageReader::with_format(Cursor::new(data), format);
    reader.limits(decoder_limits(size));
    let decoder = reader.into_decoder().map_err(bad)?;
    same_size(field, decoder.dimensions(), size)?;
    DynamicImage::from_decoder(decoder).map_err(bad)
}

/// Memory that a decoder may use for an image of the camera's size.
fn decoder_limits((width, height): Size) -> Limits {
    // The widest pixel is RGBA of 16 bits; doubled for the decoder's buffers.
    const BYTES_PER_PIXEL: u64 = 8 * 2;
    const TABLE_BYTES: u64 = 1 << 20;
    let mut limits = Limits::default();
    limits.max_alloc = Some(u64::from(width) * u64::from(height) * BYTES_PER_PIXEL + TABLE_BYTES);
    limits
}

fn same_size(field: &str, found: Size, (width, height): Size) -> Result<(), Refusal> {
    if found == (width, height) {
        return Ok(());
    }
    let reason =
        format!("expected {width}x{height} as in the intrinsics, found {}x{}", found.0, found.1);
    Err(Refusal::new(field, reason))
}

/// Reads little-endian 16-bit numbers, one for each pixel.
pub(super) fn u16s(field: &str, data: &[u8], pixels: usize) -> Result<Vec<u16>, Refusal> {
    length(field, data, pixels, 2)?;
    Ok(data.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect())
}

/// Checks the number of bytes of an uncompressed image.
pub(super) fn length(
    field: &str,
    data: &[u8],
    pixels: usize,
    bytes_per_pixel: usize,
) -> Result<(), Refusal> {
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

/// Decompresses zstd. It stops one byte after `expected`, whatever size the stream announces.
pub(super) fn unzstd(field: &str, data: &[u8], expected: usize) -> Result<Vec<u8>, Refusal> {
    let bad = |error| Refusal::new(field, format!("not zstd ({} bytes): {error}", data.len()));
    let mut decoder = zstd::Decoder::new(data).map_err(bad)?;
    decoder.window_log_max(ZSTD_WINDOW_LOG_MAX).map_err(bad)?;
    let mut unpacked = Vec::with_capacity(expected);
    decoder.take(expected as u64 + 1).read_to_end(&mut unpacked).map_err(bad)?;
    if unpacked.len() > expected {
        let reason = format!("decompresses to more than the expected {expected} bytes");
        return Err(Refusal::new(field, reason));
    }
    Ok(unpacked)
}
