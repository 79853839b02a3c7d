//! JPEG and PNG as they are in messages: what their first bytes say.

use super::error::MessageError;
use crate::dataset::ColorFormat;
use std::io::Cursor;

const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Bits of a sample, and which samples a pixel has, of a PNG.
pub(super) fn png_kind(data: &[u8]) -> Option<[u8; 2]> {
    let header = data.strip_prefix(PNG_MAGIC)?;
    Some([*header.get(16)?, *header.get(17)?])
}

/// What a compressed picture is.
pub(super) fn format(data: &[u8]) -> Result<ColorFormat, MessageError> {
    match data {
        data if data.starts_with(PNG_MAGIC) => Ok(ColorFormat::Png),
        [0xff, 0xd8, ..] => Ok(ColorFormat::Jpeg),
        _ => Err(MessageError::content("expected a JPEG or PNG picture")),
    }
}

/// Columns and rows of a JPEG or PNG.
pub(super) fn size(data: &[u8]) -> Result<(u32, u32), MessageError> {
    let reader = image::ImageReader::new(Cursor::new(data)).with_guessed_format();
    let size =
        reader.map_err(image::ImageError::IoError).and_then(image::ImageReader::into_dimensions);
    size.map_err(|error| MessageError::content(format!("expected a JPEG or PNG picture: {error}")))
}
