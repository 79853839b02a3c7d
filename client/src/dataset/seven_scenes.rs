//! 7-Scenes layout: `frame-%06d.color.jpg` (or `.png`), `frame-%06d.depth.png` (millimetres; 0 and
//! 65535 are no measurement), `frame-%06d.pose.txt` (`world_from_camera`, 4x4), and optionally
//! `camera-intrinsics.txt` (3x3; the Kinect's 585, 585, 320, 240 if missing). Numbers may have
//! gaps: a frame keeps its number. With the Kinect's own intrinsics color is not registered to
//! depth in these files, and is brought there ([`kinect`]); with other intrinsics it is taken as it
//! is.

use super::error::DatasetError;
use super::files::Size;
use super::frame::{Color, ColorFormat, Intrinsics, RgbdFrame, counted_nanos};
use super::source::Dataset;
use super::{files, kinect, pose};
use image::{DynamicImage, ExtendedColorType, ImageBuffer, ImageEncoder, Luma, codecs::png};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

const NO_MEASUREMENT: u16 = u16::MAX;

/// A sequence in 7-Scenes layout.
#[derive(Debug)]
pub struct SevenScenes {
    name: String,
    intrinsics: Intrinsics,
    frames: Vec<Entry>,
    skipped: Vec<String>,
}

#[derive(Debug)]
struct Entry {
    sequence: u64,
    color: PathBuf,
    depth: PathBuf,
    world_from_camera: Isometry3<f64>,
}

impl SevenScenes {
    /// Finds the files and reads camera and poses.
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let colors = files::numbered(folder, "frame-", &[".color.jpg", ".color.png"])?;
        let mut depths = files::numbered(folder, "frame-", &[".depth.png"])?;
        let (mut frames, mut skipped) = (Vec::new(), Vec::new());
        for (sequence, color) in colors {
            let Some(depth) = depths.remove(&sequence) else {
                let reason =
                    format!("expected frame-{sequence:06}.depth.png beside it, found none");
                return Err(DatasetError::content(&color, reason));
            };
            let path = folder.join(format!("frame-{sequence:06}.pose.txt"));
            let matrix = files::numbers::<16>(&files::text(&path)?)
                .map_err(|reason| DatasetError::content(&path, reason))?;
            match pose::from_matrix(&matrix) {
                Ok(world_from_camera) => {
                    frames.push(Entry { sequence, color, depth, world_from_camera });
                }
                Err(reason) => skipped.push(DatasetError::content(&path, reason).to_string()),
            }
        }
        let Some(first) = frames.first() else {
            let reason = "expected frame-%06d.color.jpg (or .png) with a valid pose, found none; \
                          name one sequence, such as its folder seq-01";
            return Err(DatasetError::content(folder, reason));
        };
        let size = files::size(&first.color)?;
        files::check_size(&first.depth, size)?;
        let intrinsics = intrinsics(&folder.join("camera-intrinsics.txt"), size)?;
        Ok(Self { name: files::name_of(folder), intrinsics, frames, skipped })
    }
}

fn intrinsics(path: &Path, size: Size) -> Result<Intrinsics, DatasetError> {
    let [fx, fy, cx, cy] = if path.is_file() {
        let [fx, _, cx, _, fy, cy, _, _, _] = files::numbers::<9>(&files::text(path)?)
            .map_err(|reason| DatasetError::content(path, reason))?;
        [fx, fy, cx, cy]
    } else {
        kinect::DEPTH
    };
    Ok(Intrinsics { width: size.width, height: size.height, fx, fy, cx, cy })
}

type Units = ImageBuffer<Luma<u16>, Vec<u16>>;

/// Depth in millimetres, 0 without a measurement; and whether the file has it so already.
fn units(path: &Path, bytes: &[u8]) -> Result<(Units, bool), DatasetError> {
    let mut units = match files::picture(path, bytes)? {
        DynamicImage::ImageLuma16(units) => units,
        other => {
            let reason = format!("expected 16-bit grey, found {:?}", other.color());
            return Err(DatasetError::content(path, reason));
        }
    };
    let is_whole = !units.contains(&NO_MEASUREMENT);
    units.iter_mut().filter(|unit| **unit == NO_MEASUREMENT).for_each(|unit| *unit = 0);
    Ok((units, is_whole))
}

/// Encodes a PNG, fast rather than small.
fn encoded(
    samples: &[u8],
    size: Size,
    kind: ExtendedColorType,
    sequence: u64,
) -> Result<Vec<u8>, DatasetError> {
    let mut bytes = Vec::new();
    let (fast, filter) = (png::CompressionType::Fast, png::FilterType::Adaptive);
    png::PngEncoder::new_with_quality(&mut bytes, fast, filter)
        .write_image(samples, size.width, size.height, kind)
        .map_err(|source| DatasetError::Encode { sequence, source })?;
    Ok(bytes)
}

impl SevenScenes {
    /// Whether color and depth come from the Kinect's two cameras and are not registered.
    fn is_unregistered(&self) -> bool {
        let Intrinsics { width, height, fx, fy, cx, cy } = self.intrinsics;
        (width, height, [fx, fy, cx, cy]) == (640, 480, kinect::DEPTH)
    }

    /// The color image, registered to the depth image.
    fn color(&self, entry: &Entry, units: &Units) -> Result<Color, DatasetError> {
        let color = files::color(&entry.color)?;
        if !self.is_unregistered() {
            return Ok(color);
        }
        let failed = |source| DatasetError::Picture { path: entry.color.clone(), source };
        let picture = image::load_from_memory(&color.bytes).map_err(failed)?.into_rgb8();
        if picture.dimensions() != units.dimensions() {
            let (width, height) = units.dimensions();
            let reason = format!("expected {width}x{height} pixels as its depth has");
            return Err(DatasetError::content(&entry.color, reason));
        }
        let seen = kinect::registered(&picture, units);
        let size = Size { width: seen.width(), height: seen.height() };
        let bytes = encoded(&seen, size, ExtendedColorType::Rgb8, entry.sequence)?;
        Ok(Color { format: ColorFormat::Png, bytes })
    }
}

impl Dataset for SevenScenes {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn depth_unit_metres(&self) -> f64 {
        0.001
    }

    fn sequence(&self, index: usize) -> u64 {
        self.frames[index].sequence
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let entry = &self.frames[index];
        let mut depth = files::depth(&entry.depth)?;
        let (units, is_whole) = units(&entry.depth, &depth.bytes)?;
        let color = self.color(entry, &units)?;
        if !is_whole {
            // The encoder takes samples in native byte order.
            let samples: Vec<u8> = units.iter().flat_map(|unit| unit.to_ne_bytes()).collect();
            let size = Size { width: units.width(), height: units.height() };
            depth.bytes = encoded(&samples, size, ExtendedColorType::L16, entry.sequence)?;
        }
        Ok(RgbdFrame {
            sequence: entry.sequence,
            timestamp_nanos: counted_nanos(entry.sequence),
            color,
            depth,
            world_from_camera: Some(entry.world_from_camera),
        })
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }
}
