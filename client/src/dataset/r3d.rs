//! Record3D's `.r3d` files: a zip of `metadata` (JSON), `rgbd/N.jpg`, `rgbd/N.depth` and `rgbd/N.conf`.
//!
//! `metadata` has the size of color (`w`, `h`) and of depth (`dw`, `dh`), the camera `K` (3x3, column by
//! column) or one for each frame (`perFrameIntrinsicCoeffs`, `fx fy cx cy`), `poses` (`qx qy qz qw tx ty
//! tz`, `world_from_camera`, camera axes x right, y up, z back, world y up) and `frameTimestamps`
//! (seconds). Depth is float32 metres and confidence a byte (0 low, 1 medium, 2 high), LZFSE, zlib or as
//! they are. Depth comes through color's lens. Pixels of low confidence are no measurement.

use super::error::DatasetError;
use super::files::{self, Size};
use super::frame::{
    Camera, Cameras, Color, ColorFormat, Depth, DepthCamera, FrameExtras, FrameRate, Intrinsics,
};
use super::inflate::{exactly, inflated};
use super::layer::Layer;
use super::prepare::{self, FINE_UNIT_METRES, Units};
use super::recording::{MaybePose, Pictures, Recording, Shot};
use super::source::Dataset;
use super::{name, pose, text};
use lzfse_rust::LzfseRingDecoder;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use zip::ZipArchive;

const METADATA: &str = "metadata";
const FOLDER: &str = "rgbd/";
/// The largest file in the zip that is read, bytes.
const LARGEST: u64 = 256 << 20;
/// The confidence from which on depth is a measurement: medium.
const LEAST_CONFIDENCE: u8 = 1;
const FLOAT: usize = size_of::<f32>();

/// A `.r3d` file.
#[derive(Debug)]
pub struct R3d {
    recording: Recording,
}

#[derive(Deserialize)]
struct Metadata {
    #[serde(deserialize_with = "text::whole_number")]
    w: u32,
    #[serde(deserialize_with = "text::whole_number")]
    h: u32,
    dw: Option<f64>,
    dh: Option<f64>,
    fps: Option<f64>,
    #[serde(rename = "K")]
    camera: Option<Vec<f64>>,
    #[serde(rename = "perFrameIntrinsicCoeffs", default)]
    cameras: Vec<Vec<f64>>,
    #[serde(default)]
    poses: Vec<Vec<f64>>,
    #[serde(rename = "frameTimestamps", default)]
    times: Vec<f64>,
}

/// The files of a frame.
#[derive(Clone, Default)]
struct Names {
    color: Option<String>,
    depth: Option<String>,
    confidence: Option<String>,
}

type Archive = ZipArchive<BufReader<File>>;

impl R3d {
    /// Reads the list of files and `metadata`.
    ///
    /// # Errors
    /// [`DatasetError`] if it is no such file, the camera is missing or damaged, or no frame has depth.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        let wrong = |reason: String| DatasetError::content(path, reason);
        let file =
            File::open(path).map_err(|source| DatasetError::File { path: path.into(), source })?;
        let mut archive = ZipArchive::new(BufReader::new(file))
            .map_err(|error| wrong(format!("expected a zip, as .r3d files are: {error}")))?;
        let written = read(&mut archive, METADATA).map_err(wrong)?;
        let metadata: Metadata = serde_json::from_str(&text::decoded(&written))
            .map_err(|error| wrong(format!("{METADATA}: {error}")))?;
        let (numbers, frames, skipped) = frames(path, &archive);
        let Some(first) = frames.first() else {
            let expected = "expected rgbd/0.jpg with rgbd/0.depth, found none";
            return Err(DatasetError::no_frames(path, expected, &skipped));
        };
        let color = color_size(&mut archive, &frames).map_err(wrong)?;
        let depth = metadata.depth_size(&mut archive, first).map_err(wrong)?;
        let usual = metadata.intrinsics(0, color).map_err(wrong)?;
        let shots = numbers.iter().map(|&number| metadata.shot(path, number, color, &usual));
        let shots = shots.collect();
        let Size { width, height } = depth;
        let cameras = Cameras {
            color: Camera::from(usual),
            depth: (color != depth).then_some(DepthCamera::SameLens { width, height }),
            up: Some([0.0, 1.0, 0.0]),
            ..usual.into()
        };
        let archive = Mutex::new(archive);
        let pictures = Box::new(Stored { path: path.into(), archive, frames, depth });
        let recording = Recording {
            name: name::of(&path.with_extension("")),
            cameras,
            depth_unit_metres: FINE_UNIT_METRES,
            shots,
            pictures,
            skipped,
            notes: Vec::new(),
        };
        Ok(Self { recording })
    }
}

/// The frames with color and depth by number, and what is told of the others.
fn frames(path: &Path, archive: &Archive) -> (Vec<usize>, Vec<Names>, Vec<String>) {
    let mut found: BTreeMap<usize, Names> = BTreeMap::new();
    for name in archive.file_names().filter_map(Result::ok) {
        let Some((number, kind)) = name.strip_prefix(FOLDER).and_then(|name| name.split_once('.'))
        else {
            continue;
        };
        let Ok(number) = number.parse() else { continue };
        let names: &mut Names = found.entry(number).or_default();
        match kind {
            "jpg" | "jpeg" | "png" => names.color = Some(name.into_owned()),
            "depth" => names.depth = Some(name.into_owned()),
            "conf" => names.confidence = Some(name.into_owned()),
            _ => {}
        }
    }
    let is_whole = |names: &Names| names.color.is_some() && names.depth.is_some();
    let (whole, other): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|(_, names)| is_whole(names));
    let told = |(number, _): (usize, Names)| {
        let reason = format!("frame {number}: expected .jpg and .depth, found only one of them");
        DatasetError::content(path, reason).to_string()
    };
    let skipped = other.into_iter().map(told).collect();
    let (numbers, frames) = whole.into_iter().unzip();
    (numbers, frames, skipped)
}

/// A file of the zip.
fn read(archive: &mut Archive, name: &str) -> Result<Vec<u8>, String> {
    let wrong = |reason: String| format!("{name}: {reason}");
    let file = archive.by_name(name).map_err(|error| wrong(error.to_string()))?;
    if file.size() > LARGEST {
        return Err(wrong(format!("expected at most {LARGEST} bytes, found {}", file.size())));
    }
    let mut bytes = Vec::new();
    file.take(LARGEST).read_to_end(&mut bytes).map_err(|error| wrong(error.to_string()))?;
    Ok(bytes)
}

/// The size of the first color picture that can be read.
fn color_size(archive: &mut Archive, frames: &[Names]) -> Result<Size, String> {
    let mut wrong = String::new();
    for name in frames.iter().filter_map(|names| names.color.as_ref()) {
        let size = read(archive, name).and_then(|bytes| {
            files::encoded_size(&bytes).map_err(|error| format!("{name}: {error}"))
        });
        match size {
            Ok(size) => return Ok(size),
            Err(reason) if wrong.is_empty() => wrong = reason,
            Err(_) => {}
        }
    }
    Err(wrong)
}

impl Metadata {
    /// The size of depth: as it is said, or of the same shape as color.
    fn depth_size(&self, archive: &mut Archive, first: &Names) -> Result<Size, String> {
        let side = |value: f64| value.fract() == 0.0 && (1.0..=8192.0).contains(&value);
        if let (Some(width), Some(height)) = (self.dw, self.dh) {
            return match side(width) && side(height) {
                true => Ok(Size { width: width as u32, height: height as u32 }),
                false => {
                    Err(format!("{METADATA}: dw, dh: expected pixels, found {width}x{height}"))
                }
            };
        }
        let name = first.depth.as_deref().unwrap_or_default();
        let pixels = decompressed(&read(archive, name)?)?.len() / FLOAT;
        let width = (pixels as f64 * f64::from(self.w) / f64::from(self.h.max(1))).sqrt().round();
        let height = pixels as f64 / width;
        match side(width) && side(height) {
            true => Ok(Size { width: width as u32, height: height as u32 }),
            false => Err(format!(
                "{METADATA} has no dw and dh, and {pixels} pixels of depth do not fit color"
            )),
        }
    }

    /// The camera of a frame, for pictures of a size that may be another one than is said.
    fn intrinsics(&self, number: usize, size: Size) -> Result<Intrinsics, String> {
        let own = self.cameras.get(number).and_then(|own| own.first_chunk::<4>());
        let [fx, fy, cx, cy] = match (own, self.camera.as_deref()) {
            (Some(own), _) => *own,
            (None, Some([fx, _, _, _, fy, _, cx, cy, _])) => [*fx, *fy, *cx, *cy],
            (None, _) => return Err(format!("{METADATA}: expected K, 3x3")),
        };
        let is_lens = fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|n| n.is_finite());
        if !is_lens || self.w == 0 || self.h == 0 {
            let found = format!("{fx} {fy} {cx} {cy} for {}x{}", self.w, self.h);
            return Err(format!("{METADATA}: expected fx fy cx cy, found {found}"));
        }
        let said = Intrinsics { width: self.w, height: self.h, fx, fy, cx, cy };
        Ok(said.scaled(size.width, size.height))
    }

    fn pose(&self, number: usize) -> MaybePose {
        let written = self.poses.get(number).ok_or("expected a pose, found none")?;
        let [i, j, k, w, x, y, z] = written[..] else {
            return Err(format!("expected a pose of 7 numbers, found {}", written.len()));
        };
        Ok(pose::Axes::OpenGl.to_opencv(&pose::from_tum(&[x, y, z, i, j, k, w])?))
    }

    fn nanos(&self, number: usize) -> u64 {
        match self.times.get(number) {
            Some(seconds) if seconds.is_finite() && *seconds >= 0.0 => (seconds * 1e9) as u64,
            _ => {
                let rate = self.fps.and_then(|rate| FrameRate::try_from(rate).ok());
                rate.unwrap_or_default().nanos(number as u64)
            }
        }
    }

    fn shot(&self, path: &Path, number: usize, color: Size, usual: &Intrinsics) -> Shot {
        let own = self.intrinsics(number, color).ok().filter(|own| own != usual);
        Shot {
            sequence: number as u64,
            nanos: self.nanos(number),
            world_from_camera: self.pose(number).map_err(|reason| {
                format!("{}: {METADATA}: frame {number}: {reason}", path.display())
            }),
            extras: FrameExtras { intrinsics: own, ..FrameExtras::default() },
        }
    }
}

/// The bytes of depth or confidence, of a length that is not known.
fn decompressed(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut decoder = LzfseRingDecoder::default();
    let mut found = Vec::new();
    let limit = LARGEST;
    let read = match bytes {
        [b'b', b'v', b'x', ..] => decoder.reader_bytes(bytes).take(limit).read_to_end(&mut found),
        _ => flate2::read::ZlibDecoder::new(bytes).take(limit).read_to_end(&mut found),
    };
    match read {
        Ok(_) => Ok(found),
        Err(error) => Err(format!("cannot be decompressed: {error}")),
    }
}

/// The `expected` bytes of depth or confidence.
fn unpacked(bytes: Vec<u8>, expected: usize) -> Result<Vec<u8>, String> {
    match &bytes[..] {
        _ if bytes.len() == expected => Ok(bytes),
        [b'b', b'v', b'x', ..] => {
            exactly(LzfseRingDecoder::default().reader_bytes(&bytes), expected)
        }
        _ => inflated(&bytes, expected),
    }
}

/// The pictures in the file.
struct Stored {
    path: PathBuf,
    archive: Mutex<Archive>,
    frames: Vec<Names>,
    depth: Size,
}

impl Stored {
    fn file(&self, name: &str) -> Result<Vec<u8>, String> {
        // A panic while reading leaves an archive that can be read again.
        let mut archive = self.archive.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        read(&mut archive, name)
    }

    fn unpacked(&self, name: &str, each: usize) -> Result<Vec<u8>, String> {
        let expected = self.depth.width as usize * self.depth.height as usize * each;
        unpacked(self.file(name)?, expected).map_err(|reason| format!("{name}: {reason}"))
    }

    fn color(&self, names: &Names) -> Result<Color, String> {
        let name = names.color.as_deref().unwrap_or_default();
        let bytes = self.file(name)?;
        let is_png = bytes.starts_with(b"\x89PNG");
        Ok(Color { format: if is_png { ColorFormat::Png } else { ColorFormat::Jpeg }, bytes })
    }

    fn units(&self, names: &Names) -> Result<Units, String> {
        let metres = self.unpacked(names.depth.as_deref().unwrap_or_default(), FLOAT)?;
        let sure = names.confidence.as_deref().map(|name| self.unpacked(name, 1)).transpose()?;
        let float = |four: &[u8]| f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
        let units = metres.chunks_exact(FLOAT).enumerate().map(|(at, four)| {
            let is_sure = sure.as_ref().is_none_or(|sure| sure[at] >= LEAST_CONFIDENCE);
            let unit = prepare::unit(f64::from(float(four)) / FINE_UNIT_METRES);
            if is_sure { unit } else { 0 }
        });
        let Size { width, height } = self.depth;
        Ok(Units::from_raw(width, height, units.collect()).expect("as many as pixels"))
    }
}

impl Pictures for Stored {
    fn pictures(&self, index: usize, sequence: u64) -> Result<(Color, Depth), DatasetError> {
        let names = &self.frames[index];
        let wrong = |reason: String| DatasetError::content(&self.path, reason);
        let color = self.color(names).map_err(wrong)?;
        let units = self.units(names).map_err(wrong)?;
        Ok((color, prepare::encoded(&units, sequence)?))
    }
}

impl Layer for R3d {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }
}
