//! ScanNet's `.sens` files, version 4, as its SensReader describes them, little-endian: version (u32), name
//! of the sensor (u64 bytes), intrinsics and extrinsics of color and of depth (four 4x4 float32, row by
//! row), compression of color and depth (i32), sizes (u32), units of depth per metre (float32), number of
//! frames (u64), and then each frame: `world_from_camera` (4x4 float32), times of color and depth (u64 µs),
//! sizes of both (u64), color, depth.
//!
//! Extrinsics are poses in a common frame, color's as a rule. A frame's number is its place in the file. A
//! file that ends early has the frames before its end.

use super::error::DatasetError;
use super::frame::{
    Camera, Cameras, Color, ColorFormat, Depth, DepthCamera, FrameExtras, Intrinsics, counted_nanos,
};
use super::inflate::{exactly, inflated};
use super::layer::Layer;
use super::prepare::{self, Units};
use super::recording::{MaybePose, Pictures, Recording, Shot};
use super::source::Dataset;
use super::{name, pose};
use nalgebra::Isometry3;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

const VERSION: u32 = 4;
/// The longest name of a sensor that is believed, bytes.
const LONGEST_NAME: u64 = 4096;
/// The most pixels of a picture that are believed.
const MOST_PIXELS: u64 = 1 << 27;

/// A `.sens` file.
#[derive(Debug)]
pub struct ScanNet {
    recording: Recording,
}

impl ScanNet {
    /// Reads cameras, poses and the places of the pictures.
    ///
    /// # Errors
    /// [`DatasetError`] if it is no such file, it is compressed in another way, or no frame is there.
    pub fn open(path: &Path) -> Result<Self, DatasetError> {
        let failed = |source| DatasetError::File { path: path.into(), source };
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut source = Source { file: BufReader::new(file), length, path };
        let header = Header::read(&mut source)?;
        let world_from_base = |pose: &[f32; 16]| isometry(pose);
        let (mut shots, mut places, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
        for sequence in 0..header.frames {
            let (written, place) = match source.frame() {
                Ok(frame) => frame,
                Err(reason) => {
                    let missing = header.frames - sequence;
                    let reason = format!("frame {sequence}: {reason}");
                    let told = match missing {
                        1 => reason,
                        _ => format!("{reason}; {} frames after it are missing", missing - 1),
                    };
                    skipped.push(DatasetError::content(path, told).to_string());
                    break;
                }
            };
            let world_from_camera = world_from_base(&written.pose)
                .map(|pose| pose * header.base_from_color)
                .map_err(|reason| format!("{}: frame {sequence}: {reason}", path.display()));
            shots.push(written.shot(sequence, world_from_camera));
            places.push(place);
        }
        if shots.is_empty() {
            return Err(DatasetError::no_frames(path, "expected frames, found none", &skipped));
        }
        let name = name::of(&path.with_extension(""));
        let (cameras, notes) = (header.cameras(), header.notes.clone());
        let depth_unit_metres = 1.0 / f64::from(header.depth_shift);
        let file = Mutex::new(source.file.into_inner());
        let pictures = Box::new(Stored { path: path.into(), file, places, header });
        let recording =
            Recording { name, cameras, depth_unit_metres, shots, pictures, skipped, notes };
        Ok(Self { recording })
    }
}

/// What is common to all frames.
struct Header {
    color: Intrinsics,
    depth: Intrinsics,
    base_from_color: Isometry3<f64>,
    base_from_depth: Isometry3<f64>,
    color_format: ColorFormat,
    is_deflated: bool,
    depth_shift: f32,
    frames: u64,
    notes: Vec<String>,
}

/// Where the pictures of a frame are.
struct Place {
    offset: u64,
    color_bytes: u64,
    depth_bytes: u64,
}

/// What stands before the pictures of a frame.
struct Written {
    pose: [f32; 16],
    color_micros: u64,
    depth_micros: u64,
}

impl Written {
    fn shot(&self, sequence: u64, world_from_camera: MaybePose) -> Shot {
        let nanos = |micros: u64| micros.saturating_mul(1000);
        let has_times = self.color_micros > 0;
        let depth_timestamp_nanos = (has_times && self.depth_micros > 0)
            .then(|| nanos(self.depth_micros))
            .filter(|depth| *depth != nanos(self.color_micros));
        Shot {
            sequence,
            nanos: if has_times { nanos(self.color_micros) } else { counted_nanos(sequence) },
            world_from_camera,
            extras: FrameExtras { depth_timestamp_nanos, ..FrameExtras::default() },
        }
    }
}

fn isometry(rows: &[f32; 16]) -> MaybePose {
    pose::from_matrix(&rows.map(f64::from))
}

impl Header {
    fn read(source: &mut Source) -> Result<Self, DatasetError> {
        let path = source.path;
        let wrong = |reason: String| DatasetError::content(path, reason);
        let version = source.u32().map_err(wrong)?;
        if version != VERSION {
            let reason = format!("expected a .sens file of version {VERSION}, found {version}");
            return Err(wrong(reason));
        }
        let length = source.u64().map_err(wrong)?;
        if length > LONGEST_NAME {
            return Err(wrong(format!(
                "expected the name of a sensor, found one of {length} bytes"
            )));
        }
        source.bytes(length as usize).map_err(wrong)?;
        Self::after_name(source).map_err(wrong)
    }

    fn after_name(source: &mut Source) -> Result<Self, String> {
        let [color_lens, color_place, depth_lens, depth_place] =
            [source.matrix()?, source.matrix()?, source.matrix()?, source.matrix()?];
        let color_format = match source.u32()? as i32 {
            0 => ColorFormat::Rgb8,
            1 => ColorFormat::Png,
            2 => ColorFormat::Jpeg,
            other => return Err(format!("color: expected raw, PNG or JPEG, found kind {other}")),
        };
        let is_deflated = match source.u32()? as i32 {
            0 => false,
            1 => true,
            other => {
                let reason = "depth: expected raw_ushort or zlib_ushort, found kind";
                return Err(format!("{reason} {other}; export it with zlib_ushort"));
            }
        };
        let color = intrinsics("color", [source.u32()?, source.u32()?], &color_lens)?;
        let depth = intrinsics("depth", [source.u32()?, source.u32()?], &depth_lens)?;
        let depth_shift = f32::from_bits(source.u32()?);
        if !(depth_shift.is_finite() && depth_shift > 0.0) {
            return Err(format!("expected units of depth per metre, found {depth_shift}"));
        }
        let mut notes = Vec::new();
        let mut placed = |what, rows: &[f32; 16]| {
            isometry(rows).unwrap_or_else(|reason| {
                notes.push(format!("extrinsics of {what} are not used: {reason}"));
                Isometry3::identity()
            })
        };
        let base_from_color = placed("color", &color_place);
        let base_from_depth = placed("depth", &depth_place);
        let frames = source.u64()?;
        Ok(Self {
            color,
            depth,
            base_from_color,
            base_from_depth,
            color_format,
            is_deflated,
            depth_shift,
            frames,
            notes,
        })
    }

    fn cameras(&self) -> Cameras {
        let camera: Camera = self.depth.into();
        let color_from_depth = self.base_from_color.inverse() * self.base_from_depth;
        let is_registered = self.depth == self.color && color_from_depth == Isometry3::identity();
        let own = DepthCamera::Own { camera, color_from_depth };
        Cameras { depth: (!is_registered).then_some(own), ..self.color.into() }
    }
}

/// The camera of a 4x4 matrix.
fn intrinsics(
    what: &str,
    [width, height]: [u32; 2],
    matrix: &[f32; 16],
) -> Result<Intrinsics, String> {
    let pixels = u64::from(width) * u64::from(height);
    let [fx, fy, cx, cy] = [0, 5, 2, 6].map(|at| f64::from(matrix[at]));
    if !(1..=MOST_PIXELS).contains(&pixels) {
        return Err(format!("{what}: expected the size of a picture, found {width}x{height}"));
    }
    match [fx, fy, cx, cy].iter().all(|number| number.is_finite()) && fx > 0.0 && fy > 0.0 {
        true => Ok(Intrinsics { width, height, fx, fy, cx, cy }),
        false => {
            Err(format!("{what}: expected intrinsics, found fx fy cx cy = {fx} {fy} {cx} {cy}"))
        }
    }
}

/// The file while its frames are found.
struct Source<'a> {
    file: BufReader<File>,
    length: u64,
    path: &'a Path,
}

impl Source<'_> {
    fn bytes(&mut self, count: usize) -> Result<Vec<u8>, String> {
        exactly(self.file.by_ref().take(count as u64), count)
            .map_err(|reason| format!("the file ends or cannot be read: {reason}"))
    }

    fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.bytes(4)?.try_into().expect("four bytes")))
    }

    fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.bytes(8)?.try_into().expect("eight bytes")))
    }

    fn matrix(&mut self) -> Result<[f32; 16], String> {
        let mut rows = [0.0; 16];
        for number in &mut rows {
            *number = f32::from_bits(self.u32()?);
        }
        Ok(rows)
    }

    /// Reads what stands before a frame's pictures and goes past them.
    fn frame(&mut self) -> Result<(Written, Place), String> {
        let pose = self.matrix()?;
        let [color_micros, depth_micros] = [self.u64()?, self.u64()?];
        let [color_bytes, depth_bytes] = [self.u64()?, self.u64()?];
        let failed = |error: std::io::Error| error.to_string();
        let offset = self.file.stream_position().map_err(failed)?;
        let bytes = color_bytes.checked_add(depth_bytes);
        let end = bytes.and_then(|bytes| offset.checked_add(bytes));
        if end.is_none_or(|end| end > self.length) {
            return Err("the file ends within its pictures".into());
        }
        let ahead = i64::try_from(color_bytes + depth_bytes).map_err(|error| error.to_string())?;
        self.file.seek_relative(ahead).map_err(failed)?;
        let written = Written { pose, color_micros, depth_micros };
        Ok((written, Place { offset, color_bytes, depth_bytes }))
    }
}

/// The pictures in the file.
struct Stored {
    path: PathBuf,
    file: Mutex<File>,
    places: Vec<Place>,
    header: Header,
}

impl Stored {
    /// The bytes of color and depth as they are in the file.
    fn bytes(&self, place: &Place) -> Result<[Vec<u8>; 2], DatasetError> {
        let failed = |source| DatasetError::File { path: self.path.clone(), source };
        let mut file = self.file.lock().expect("reading does not panic");
        file.seek(SeekFrom::Start(place.offset)).map_err(failed)?;
        let mut read = |bytes: u64| {
            exactly(file.by_ref().take(bytes), bytes as usize)
                .map_err(|reason| DatasetError::content(&self.path, reason))
        };
        Ok([read(place.color_bytes)?, read(place.depth_bytes)?])
    }
}

impl Pictures for Stored {
    fn pictures(&self, index: usize, sequence: u64) -> Result<(Color, Depth), DatasetError> {
        let [color, depth] = self.bytes(&self.places[index])?;
        let Intrinsics { width, height, .. } = self.header.depth;
        let expected = width as usize * height as usize * 2;
        let wrong = |reason: String| {
            DatasetError::content(&self.path, format!("frame {sequence}: depth: {reason}"))
        };
        let samples = match self.header.is_deflated {
            true => inflated(&depth, expected),
            false => exactly(&depth[..], expected),
        }
        .map_err(wrong)?;
        let units = samples.chunks_exact(2).map(|two| u16::from_le_bytes([two[0], two[1]]));
        let units = Units::from_raw(width, height, units.collect()).expect("as many as pixels");
        let depth = prepare::encoded(&units, sequence)?;
        Ok((Color { format: self.header.color_format, bytes: color }, depth))
    }
}

impl Layer for ScanNet {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }
}
