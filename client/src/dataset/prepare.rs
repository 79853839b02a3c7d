//! What is done to the pictures of a recording when they are read.
//!
//! Pictures are turned upright, arrays become images, and depth that its confidence calls bad becomes 0.
//! In: files. Out: color as JPEG or PNG, depth as 16-bit PNG. A picture that needs nothing is passed on as it
//! is.

use super::error::DatasetError;
use super::files::{self, Size};
use super::frame::{Color, ColorFormat, Depth, DepthFormat};
use crate::npy;
use image::codecs::{jpeg, png};
use image::imageops::{rotate90, rotate180, rotate270};
use image::{DynamicImage, ExtendedColorType, ImageBuffer, ImageEncoder, Luma, RgbImage};
use std::path::{Path, PathBuf};

/// A depth image, decoded.
pub(super) type Units = ImageBuffer<Luma<u16>, Vec<u16>>;

/// Metres per unit in which depth is sent that is stored as numbers with fractions: up to 16 m.
pub(super) const FINE_UNIT_METRES: f64 = 0.00025;
/// Quality of JPEG pictures that had to be turned, of 100.
const QUALITY: u8 = 95;

/// By how much pictures are turned, clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(try_from = "u32")]
pub(super) enum Turn {
    #[default]
    None,
    Right,
    Half,
    Left,
}

impl TryFrom<u32> for Turn {
    type Error = String;

    fn try_from(degrees: u32) -> Result<Self, String> {
        match degrees {
            0 => Ok(Self::None),
            90 => Ok(Self::Right),
            180 => Ok(Self::Half),
            270 => Ok(Self::Left),
            _ => Err(format!("turned: expected 0, 90, 180 or 270 degrees, found {degrees}")),
        }
    }
}

impl Turn {
    fn size(self, Size { width, height }: Size) -> Size {
        match self {
            Self::None | Self::Half => Size { width, height },
            Self::Right | Self::Left => Size { width: height, height: width },
        }
    }

    fn color(self, picture: RgbImage) -> RgbImage {
        match self {
            Self::None => picture,
            Self::Right => rotate90(&picture),
            Self::Half => rotate180(&picture),
            Self::Left => rotate270(&picture),
        }
    }

    fn depth(self, units: Units) -> Units {
        match self {
            Self::None => units,
            Self::Right => rotate90(&units),
            Self::Half => rotate180(&units),
            Self::Left => rotate270(&units),
        }
    }
}

/// What is done to the pictures of one recording.
#[derive(Debug)]
pub(super) struct Preparation {
    pub color_turn: Turn,
    pub depth_turn: Turn,
    /// Units that are sent per unit in the files.
    pub scale: f64,
    /// Depth whose confidence is less becomes 0.
    pub least_confidence: u16,
}

impl Default for Preparation {
    fn default() -> Self {
        let (color_turn, depth_turn) = (Turn::None, Turn::None);
        Self { color_turn, depth_turn, scale: 1.0, least_confidence: 0 }
    }
}

impl Preparation {
    /// The size of a color picture once it is turned.
    pub fn color_size(&self, path: &Path) -> Result<Size, DatasetError> {
        Ok(self.color_turn.size(files::size(path)?))
    }

    /// The size of a depth picture once it is turned.
    pub fn depth_size(&self, path: &Path) -> Result<Size, DatasetError> {
        let size = match is_array(path) {
            true => {
                let units = array(path, &files::bytes(path)?, 1.0)?;
                Size { width: units.width(), height: units.height() }
            }
            false => files::size(path)?,
        };
        Ok(self.depth_turn.size(size))
    }

    /// A color picture.
    pub fn color(&self, path: &Path, sequence: u64) -> Result<Color, DatasetError> {
        let color = files::color(path)?;
        if self.color_turn == Turn::None {
            return Ok(color);
        }
        let failed = |source| DatasetError::Picture { path: path.into(), source };
        let picture = image::load_from_memory(&color.bytes).map_err(failed)?.into_rgb8();
        let turned = self.color_turn.color(picture);
        let mut bytes = Vec::new();
        let (samples, (width, height)) = (turned.as_raw(), turned.dimensions());
        let written = match color.format {
            ColorFormat::Jpeg => jpeg::JpegEncoder::new_with_quality(&mut bytes, QUALITY)
                .write_image(samples, width, height, ExtendedColorType::Rgb8),
            _ => fast_png(&mut bytes).write_image(samples, width, height, ExtendedColorType::Rgb8),
        };
        written.map_err(|source| DatasetError::Encode { sequence, source })?;
        Ok(Color { format: color.format, bytes })
    }

    /// A depth picture, without the pixels that the picture `confidence` calls bad.
    pub fn depth(
        &self,
        path: &Path,
        confidence: Option<&PathBuf>,
        sequence: u64,
    ) -> Result<Depth, DatasetError> {
        let bytes = files::bytes(path)?;
        let is_plain = self.depth_turn == Turn::None && self.scale == 1.0 && confidence.is_none();
        if is_plain && !is_array(path) {
            return Ok(Depth { format: DepthFormat::Png16, bytes });
        }
        let mut units = match is_array(path) {
            true => array(path, &bytes, self.scale)?,
            false => scaled(decoded(path, &bytes)?, self.scale),
        };
        if let Some(path) = confidence {
            distrust(&mut units, path, self.least_confidence)?;
        }
        encoded(&self.depth_turn.depth(units), sequence)
    }
}

/// Whether a file is a NumPy array.
pub(super) fn is_array(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}

/// A decoded 16-bit PNG.
pub(super) fn decoded(path: &Path, bytes: &[u8]) -> Result<Units, DatasetError> {
    match files::picture(path, bytes)? {
        DynamicImage::ImageLuma16(units) => Ok(units),
        other => {
            let reason = format!("expected 16-bit grey, found {:?}", other.color());
            Err(DatasetError::content(path, reason))
        }
    }
}

/// Depth as 16-bit PNG.
pub(super) fn encoded(units: &Units, sequence: u64) -> Result<Depth, DatasetError> {
    // The encoder takes samples in native byte order.
    let samples: Vec<u8> = units.iter().flat_map(|unit| unit.to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    fast_png(&mut bytes)
        .write_image(&samples, units.width(), units.height(), ExtendedColorType::L16)
        .map_err(|source| DatasetError::Encode { sequence, source })?;
    Ok(Depth { format: DepthFormat::Png16, bytes })
}

/// An encoder that is fast rather than small.
pub(super) fn fast_png(bytes: &mut Vec<u8>) -> png::PngEncoder<&mut Vec<u8>> {
    png::PngEncoder::new_with_quality(bytes, png::CompressionType::Fast, png::FilterType::Adaptive)
}

/// A number as units of 16 bits; 0 if it is none, or too large.
pub(super) fn unit(number: f64) -> u16 {
    let rounded = number.round();
    if (1.0..f64::from(u16::MAX)).contains(&rounded) { rounded as u16 } else { 0 }
}

fn scaled(mut units: Units, scale: f64) -> Units {
    if scale != 1.0 {
        let is_none = |unit: u16| unit == u16::MAX;
        let new = |old: u16| if is_none(old) { 0 } else { unit(f64::from(old) * scale) };
        units.iter_mut().for_each(|unit| *unit = new(*unit));
    }
    units
}

/// The rows and columns of an array as an image; lengths of 1 do not count.
fn array(path: &Path, bytes: &[u8], scale: f64) -> Result<Units, DatasetError> {
    let wrong = |reason: String| DatasetError::content(path, reason);
    let array = npy::read_numbers(bytes).map_err(|error| wrong(error.to_string()))?;
    let sides: Vec<usize> = array.shape.iter().copied().filter(|side| *side != 1).collect();
    let [rows, columns] = sides[..] else {
        let found = array.shape;
        return Err(wrong(format!("expected depth of shape (rows, columns), found {found:?}")));
    };
    let units = array.values.iter().map(|value| unit(f64::from(*value) * scale)).collect();
    let sides = u32::try_from(columns).ok().zip(u32::try_from(rows).ok());
    let image = sides.and_then(|(width, height)| Units::from_raw(width, height, units));
    image.ok_or_else(|| wrong(format!("expected depth, found {rows} rows of {columns}")))
}

/// Takes depth out whose confidence is less than `least`.
fn distrust(units: &mut Units, path: &Path, least: u16) -> Result<(), DatasetError> {
    let picture = files::picture(path, &files::bytes(path)?)?;
    let confidence = match picture {
        DynamicImage::ImageLuma16(picture) => picture,
        DynamicImage::ImageLuma8(picture) => {
            let wide = picture.iter().map(|value| u16::from(*value)).collect();
            Units::from_raw(picture.width(), picture.height(), wide).expect("as many pixels")
        }
        other => {
            let reason = format!("expected grey confidence, found {:?}", other.color());
            return Err(DatasetError::content(path, reason));
        }
    };
    if confidence.dimensions() != units.dimensions() {
        let ((width, height), (columns, rows)) = (units.dimensions(), confidence.dimensions());
        let reason =
            format!("expected {width}x{height} pixels as its depth has, found {columns}x{rows}");
        return Err(DatasetError::content(path, reason));
    }
    for (unit, confidence) in units.iter_mut().zip(confidence.iter()) {
        if *confidence < least {
            *unit = 0;
        }
    }
    Ok(())
}
