//! 7-Scenes layout: `frame-%06d.color.jpg` (or `.jpeg`, `.png`), `frame-%06d.depth.png` (millimetres;
//! 0 and 65535 are no measurement), `frame-%06d.pose.txt` (`world_from_camera`, 4x4), and
//! `camera-intrinsics.txt` (3x3), without which pictures of 640x480 are taken to be the Kinect's (585, 585,
//! 320, 240), which [`Dataset::notes`] says. Numbers may have gaps: a frame keeps its number. With the
//! Kinect's own intrinsics color is not registered to depth in these files, and is brought there
//! ([`kinect`]); with other intrinsics it is taken as it is.

use super::error::DatasetError;
use super::files::Size;
use super::frame::{Color, ColorFormat, Depth, FrameRate, Intrinsics, counted_nanos};
use super::layer::Layer;
use super::numbered::{self, Pattern};
use super::picture_files::{FrameFiles, PictureFiles};
use super::prepare::{self, Units};
use super::recording::{MaybePose, Pictures, Recording, Shot};
use super::source::Dataset;
use super::{files, kinect, name, pose, text};
use image::{ExtendedColorType, ImageEncoder};
use std::path::Path;

const NO_MEASUREMENT: u16 = u16::MAX;
const COLOR: Pattern = Pattern { before: "frame-", between: ".color", extensions: numbered::COLOR };
const DEPTH: Pattern = Pattern { before: "frame-", between: ".depth", extensions: numbered::DEPTH };
/// The Kinect's pictures.
const KINECT_SIZE: Size = Size { width: 640, height: 480 };
const CAMERA_FILE: &str = "camera-intrinsics.txt";

/// A sequence in 7-Scenes layout.
#[derive(Debug)]
pub struct SevenScenes {
    recording: Recording,
}

impl SevenScenes {
    /// Finds the files and reads camera and poses.
    ///
    /// # Errors
    /// [`DatasetError`] if no frame is there, or the camera is missing or damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let numbered::Pairs { frames: pairs, skipped } = numbered::pairs(folder, &COLOR, &DEPTH)?;
        let entry = |(sequence, color, depth)| {
            let world_from_camera = pose(&folder.join(format!("frame-{sequence:06}.pose.txt")));
            let shot = Shot::new(sequence, counted_nanos(sequence), world_from_camera);
            (shot, FrameFiles::new(color, depth))
        };
        let (shots, files): (Vec<Shot>, _) = pairs.into_iter().map(entry).unzip();
        if shots.is_empty() {
            let expected = "expected frame-%06d.color.jpg (or .png) and frame-%06d.depth.png, found \
                            none; name one sequence, such as its folder seq-01";
            return Err(DatasetError::no_frames(folder, expected, &skipped));
        }
        let mut notes = Vec::new();
        let files = PictureFiles::plain(files);
        let intrinsics = intrinsics(folder, files.size()?, &mut notes)?;
        let (name, depth_unit_metres) = (name::of(folder), 0.001);
        let is_unregistered = is_unregistered(&intrinsics);
        let pictures = Box::new(ScenePictures { files, is_unregistered });
        let cameras = intrinsics.into();
        let recording =
            Recording { name, cameras, depth_unit_metres, shots, pictures, skipped, notes };
        Ok(Self { recording })
    }

    /// The same frames at other times: the layout has none.
    #[must_use]
    pub fn at_rate(mut self, rate: FrameRate) -> Self {
        self.recording.count_times(rate);
        self
    }
}

fn pose(path: &Path) -> MaybePose {
    let text = files::text(path).map_err(|error| error.whole())?;
    pose::from_rows(&text).map_err(|reason| DatasetError::content(path, reason).to_string())
}

/// The camera of the file, or the Kinect's if the pictures have its size.
fn intrinsics(
    folder: &Path,
    size: Size,
    notes: &mut Vec<String>,
) -> Result<Intrinsics, DatasetError> {
    let path = folder.join(CAMERA_FILE);
    let [fx, fy, cx, cy] = if path.is_file() {
        let [fx, _, cx, _, fy, cy, _, _, _] = text::numbers::<9>(&files::text(&path)?)
            .map_err(|reason| DatasetError::content(&path, reason))?;
        [fx, fy, cx, cy]
    } else if size == KINECT_SIZE {
        let [fx, fy, cx, cy] = kinect::DEPTH;
        notes.push(format!(
            "{} has no {CAMERA_FILE}: taken to be the benchmark's Kinect, fx fy cx cy = {fx} {fy} {cx} {cy}",
            folder.display()
        ));
        kinect::DEPTH
    } else {
        let reason = format!(
            "expected {CAMERA_FILE} (3x3), since pictures of {size} pixels are not the benchmark's"
        );
        return Err(DatasetError::content(folder, reason));
    };
    Ok(Intrinsics { width: size.width, height: size.height, fx, fy, cx, cy })
}

/// Depth in millimetres, 0 without a measurement; and whether the file has it so already.
fn units(path: &Path, bytes: &[u8]) -> Result<(Units, bool), DatasetError> {
    let mut units = prepare::decoded(path, bytes)?;
    let is_whole = !units.contains(&NO_MEASUREMENT);
    units.iter_mut().filter(|unit| **unit == NO_MEASUREMENT).for_each(|unit| *unit = 0);
    Ok((units, is_whole))
}

/// Whether color and depth come from the Kinect's two cameras and are not registered.
fn is_unregistered(camera: &Intrinsics) -> bool {
    let Intrinsics { width, height, fx, fy, cx, cy } = *camera;
    (width, height, [fx, fy, cx, cy]) == (640, 480, kinect::DEPTH)
}

/// The color image, registered to the depth image.
fn registered(
    path: &Path,
    color: &Color,
    units: &Units,
    sequence: u64,
) -> Result<Color, DatasetError> {
    let failed = |source| DatasetError::Picture { path: path.into(), source };
    let picture = image::load_from_memory(&color.bytes).map_err(failed)?.into_rgb8();
    if picture.dimensions() != units.dimensions() {
        let (width, height) = units.dimensions();
        let reason = format!("expected {width}x{height} pixels as its depth has");
        return Err(DatasetError::content(path, reason));
    }
    let seen = kinect::registered(&picture, units);
    let ((width, height), mut bytes) = (seen.dimensions(), Vec::new());
    prepare::fast_png(&mut bytes)
        .write_image(&seen, width, height, ExtendedColorType::Rgb8)
        .map_err(|source| DatasetError::Encode { sequence, source })?;
    Ok(Color { format: ColorFormat::Png, bytes })
}

/// The pictures of a sequence.
struct ScenePictures {
    files: PictureFiles,
    is_unregistered: bool,
}

impl Pictures for ScenePictures {
    fn pictures(&self, index: usize, sequence: u64) -> Result<(Color, Depth), DatasetError> {
        let files = &self.files.frames[index];
        let (color, depth) = self.files.pictures(index, sequence)?;
        let (units, is_whole) = units(&files.depth, &depth.bytes)?;
        let color = match self.is_unregistered {
            true => registered(&files.color, &color, &units, sequence)?,
            false => color,
        };
        let depth = if is_whole { depth } else { prepare::encoded(&units, sequence)? };
        Ok((color, depth))
    }
}

impl Layer for SevenScenes {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }
}
