//! Label images: grey PNG, raw 16 bit or zstd of it -> `[height * width]` labels, with their texts.

use super::images::{self, Size, u16s, unzstd};
use super::refusal::Refusal;
use crate::pipeline::frame::Labels;
use crate::pipeline::query::MAX_TEXT_BYTES;
use image::{DynamicImage, ImageFormat};
use lexsplat_proto::v1;
use std::sync::Arc;

const FIELD: &str = "labels";

/// Checks the texts of the labels and removes surrounding white space.
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

/// Decodes the frame's label image of the camera's size; `None` if it has none. `texts` are those that
/// the stream was opened with.
pub(super) fn decode(
    wire: &v1::Frame,
    size: Size,
    texts: &Arc<[String]>,
) -> Result<Option<Labels>, Refusal> {
    let (width, height) = (size.0 as usize, size.1 as usize);
    let (pixels, data) = (width * height, &wire.labels[..]);
    let ids = match v1::LabelFormat::try_from(wire.label_format) {
        Ok(v1::LabelFormat::Unspecified) if data.is_empty() => return Ok(None),
        Ok(v1::LabelFormat::Png) => png(data, size)?,
        Ok(v1::LabelFormat::U16) => u16s(FIELD, data, pixels)?,
        Ok(v1::LabelFormat::U16Zstd) => u16s(FIELD, &unzstd(FIELD, data, pixels * 2)?, pixels)?,
        Ok(v1::LabelFormat::Unspecified) | Err(_) => {
            let found = wire.label_format;
            let reason =
                format!("expected LABEL_FORMAT_PNG, _U16 or _U16_ZSTD with labels, found {found}");
            return Err(Refusal::new("label_format", reason));
        }
    };
    if texts.is_empty() {
        let reason = "the stream was opened without label_texts, so the labels have no meaning";
        return Err(Refusal::new(FIELD, reason));
    }
    if let Some(at) = ids.iter().position(|id| usize::from(*id) > texts.len()) {
        let (id, column, row) = (ids[at], at % width, at / width);
        let reason = format!(
            "expected 0 to {}, as many as label_texts, found {id} at column {column}, row {row}",
            texts.len()
        );
        return Err(Refusal::new(FIELD, reason));
    }
    Ok(Some(Labels { ids: ids.into(), texts: texts.clone() }))
}

fn png(data: &[u8], size: Size) -> Result<Vec<u16>, Refusal> {
    match images::decode(FIELD, ImageFormat::Png, data, size)? {
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
