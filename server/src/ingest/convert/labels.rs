//! Label images: grey PNG, raw 16 bit or zstd of it -> `[height * width]` labels; and what they stand
//! for.

use super::{Opening, Refusal, color, depth};
use crate::pipeline::frame::Labels;
use crate::pipeline::query::MAX_TEXT_BYTES;
use image::{DynamicImage, ImageFormat, ImageReader};
use lexsplat_proto::v1;
use std::io::Cursor;
use std::sync::Arc;

const FIELD: &str = "labels";

/// Checks what labels stand for; surrounding white space goes.
pub(super) fn texts(wire: &[String]) -> Result<Arc<[String]>, Refusal> {
    const FIELD: &str = "label_texts";
    let (limit, found) = (usize::from(u16::MAX), wire.len());
    if found > limit {
        return Err(Refusal::new(FIELD, format!("expected at most {limit} texts, found {found}")));
    }
    if let Some((at, text)) = wire.iter().enumerate().find(|(_, text)| text.len() > MAX_TEXT_BYTES)
    {
        let found = text.len();
        let reason = format!("expected at most {MAX_TEXT_BYTES} bytes, found {found} at {at}");
        return Err(Refusal::new(FIELD, reason));
    }
    Ok(wire.iter().map(|text| text.trim().to_owned()).collect())
}

/// Decodes a label image of exactly the intrinsics' size, if there is one.
pub(super) fn decode(wire: &v1::Frame, opening: &Opening) -> Result<Option<Labels>, Refusal> {
    let (width, height) = (opening.intrinsics.width, opening.intrinsics.height);
    let (pixels, data) = (width as usize * height as usize, &wire.labels[..]);
    let ids = match v1::LabelFormat::try_from(wire.label_format) {
        Ok(v1::LabelFormat::Unspecified) if data.is_empty() => return Ok(None),
        Ok(v1::LabelFormat::Png) => png(data, width, height)?,
        Ok(v1::LabelFormat::U16) => depth::u16s(FIELD, data, pixels)?,
        Ok(v1::LabelFormat::U16Zstd) => {
            depth::u16s(FIELD, &depth::unzstd(FIELD, data, pixels * 2)?, pixels)?
        }
        Ok(v1::LabelFormat::Unspecified) | Err(_) => {
            let found = wire.label_format;
            let reason =
                format!("expected LABEL_FORMAT_PNG, _U16 or _U16_ZSTD with labels, found {found}");
            return Err(Refusal::new("label_format", reason));
        }
    };
    let texts = opening.label_texts.clone();
    if texts.is_empty() {
        let reason = "the stream was opened without label_texts: what do labels stand for?";
        return Err(Refusal::new(FIELD, reason));
    }
    if let Some(at) = ids.iter().position(|id| usize::from(*id) > texts.len()) {
        let (id, column, row) = (ids[at], at % width as usize, at / width as usize);
        let reason = format!(
            "expected 0 to {}, as many as label_texts, found {id} at column {column}, row {row}",
            texts.len()
        );
        return Err(Refusal::new(FIELD, reason));
    }
    Ok(Some(Labels { ids: ids.into(), texts }))
}

fn png(data: &[u8], width: u32, height: u32) -> Result<Vec<u16>, Refusal> {
    let bad = |error| Refusal::new(FIELD, format!("{} bytes are no PNG: {error}", data.len()));
    let reader = || ImageReader::with_format(Cursor::new(data), ImageFormat::Png);
    let found = reader().into_dimensions().map_err(bad)?;
    color::same_size(FIELD, found, (width, height))?;
    let mut reader = reader();
    reader.limits(color::decoder_limits(width, height));
    match reader.decode().map_err(bad)? {
        DynamicImage::ImageLuma8(image) => {
            Ok(image.into_raw().into_iter().map(u16::from).collect())
        }
        DynamicImage::ImageLuma16(image) => Ok(image.into_raw()),
        other => Err(Refusal::new(
            FIELD,
            format!("expected a grey PNG of 8 or 16 bits, found {:?}", other.color()),
        )),
    }
}
