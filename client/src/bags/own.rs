//! Recordings of lexsplat's own server: `/lexsplat/open` has the cameras, and `/lexsplat/frame` all of a
//! frame but its pictures, which are the messages of `/camera/…` before it.

use super::files::{FilePlace, Files};
use super::store::Message;
use crate::dataset::{
    Camera, Cameras, Color, ColorFormat, DatasetError, Depth, DepthCamera, DepthFormat, Distortion,
    FrameExtras, Intrinsics, Pictures, Recording, Shot,
};
use crate::messages::{Decoder, Pixels, Reading};
use crate::rig::Wanted;
use lexsplat_proto::v1;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use prost::Message as _;
use std::path::{Path, PathBuf};

const OPEN: &str = "lexsplat.v1.OpenMap";
const FRAME: &str = "lexsplat.v1.Frame";

/// The frames that were met.
#[derive(Default)]
pub(super) struct OwnFrames {
    open: Option<v1::OpenMap>,
    /// Openings of another camera than the first, and damaged frames.
    problems: Vec<String>,
    color: Option<StoredPicture>,
    depth: Option<StoredPicture>,
    frames: Vec<Own>,
    /// Frames of another camera than the first one are left out.
    is_other_camera: bool,
}

/// Where a picture is, and how to read it.
type StoredPicture = (FilePlace, Decoder);

struct Own {
    color: StoredPicture,
    depth: StoredPicture,
    frame: v1::Frame,
}

impl OwnFrames {
    /// Takes a message of lexsplat's own topics; whether it was one that no other reader needs.
    pub(super) fn take(&mut self, message: &Message<'_>, place: FilePlace) -> bool {
        let channel = message.channel;
        match (&*channel.schema, &*channel.topic) {
            (OPEN, _) => {
                match v1::OpenMap::decode(message.data) {
                    Ok(open) => self.open(open),
                    Err(error) => self.problems.push(format!("{}: {error}", channel.topic)),
                }
                true
            }
            (FRAME, _) => {
                self.frame(message.data);
                true
            }
            (_, "/camera/color" | "/camera/color_raw") if self.open.is_some() => {
                self.color = Decoder::of(&channel.encoding, &channel.schema).map(|d| (place, d));
                true
            }
            (_, "/camera/depth" | "/camera/depth_raw") if self.open.is_some() => {
                self.depth = Decoder::of(&channel.encoding, &channel.schema).map(|d| (place, d));
                true
            }
            _ => false,
        }
    }

    fn open(&mut self, open: v1::OpenMap) {
        let Some(first) = &self.open else { return self.open = Some(open) };
        let is_same = |a: &v1::OpenMap, b: &v1::OpenMap| {
            (a.intrinsics, &a.distortion, &a.depth_camera, a.depth_unit_metres, &a.no_depth)
                == (b.intrinsics, &b.distortion, &b.depth_camera, b.depth_unit_metres, &b.no_depth)
        };
        self.is_other_camera = !is_same(first, &open);
    }

    fn frame(&mut self, data: &[u8]) {
        let (color, depth) = (self.color.take(), self.depth.take());
        let frame = match v1::Frame::decode(data) {
            Ok(frame) => frame,
            Err(error) => return self.problems.push(format!("a frame is damaged: {error}")),
        };
        if self.is_other_camera {
            let reason = "it is of another camera than the first frame";
            return self.problems.push(format!("frame {}: {reason}", frame.sequence));
        }
        match (color, depth) {
            (Some(color), Some(depth)) => self.frames.push(Own { color, depth, frame }),
            _ => self.problems.push(format!("frame {}: its pictures are missing", frame.sequence)),
        }
    }

    /// The frames, if these are lexsplat's own.
    pub(super) fn opened(self) -> Option<Self> {
        (self.open.is_some() && !self.frames.is_empty()).then_some(self)
    }

    /// As a recording.
    ///
    /// # Errors
    /// [`DatasetError`] if the opening message has no camera, or topics are wanted.
    pub(super) fn recording(
        self,
        path: &Path,
        name: String,
        files: Files,
        notes: Vec<String>,
        wanted: &Wanted,
    ) -> Result<Recording, DatasetError> {
        let wrong = |reason: &str| DatasetError::content(path, reason);
        if *wanted != Wanted::default() {
            return Err(wrong(
                "a recording of lexsplat has one color, depth and pose: expected no options",
            ));
        }
        let open = self.open.as_ref().ok_or_else(|| wrong("expected an opening message"))?;
        let cameras =
            cameras(open).ok_or_else(|| wrong("expected a camera in its opening message"))?;
        let depth_unit_metres = open.depth_unit_metres;
        let shots = self.frames.iter().map(|own| shot(&own.frame)).collect();
        let frames = self.frames.into_iter().map(OwnPictures::of).collect();
        let pictures = Box::new(Stored { path: path.to_owned(), files, frames });
        let skipped = self.problems;
        Ok(Recording { name, cameras, depth_unit_metres, shots, pictures, skipped, notes })
    }
}

fn shot(frame: &v1::Frame) -> Shot {
    let depth_nanos = frame.depth_timestamp_nanos;
    let pose = frame.world_from_camera.as_ref().and_then(pose);
    Shot {
        sequence: frame.sequence,
        nanos: frame.timestamp_nanos,
        world_from_camera: pose.ok_or_else(|| "it was recorded without a pose".to_owned()),
        extras: FrameExtras {
            intrinsics: frame.intrinsics.as_ref().map(intrinsics),
            depth_timestamp_nanos: (depth_nanos != 0).then_some(depth_nanos),
            up: frame.up.as_ref().map(vector),
        },
    }
}

/// The pictures in the files.
struct Stored {
    path: PathBuf,
    files: Files,
    frames: Vec<OwnPictures>,
}

/// The pictures of a frame.
#[derive(Clone, Copy)]
struct OwnPictures {
    color: StoredPicture,
    color_format: ColorFormat,
    depth: StoredPicture,
    depth_format: DepthFormat,
}

impl OwnPictures {
    fn of(Own { color, depth, frame }: Own) -> Self {
        let (color_format, depth_format) = (frame.color_format(), frame.depth_format());
        Self { color, color_format, depth, depth_format }
    }
}

impl Stored {
    fn pixels(&self, (place, decoder): StoredPicture) -> Result<Vec<u8>, DatasetError> {
        let bytes = self.files.read(place)?;
        match decoder.read(&bytes) {
            Ok(Reading::Picture(picture)) => Ok(match picture.pixels {
                Pixels::Raw { data, .. } | Pixels::Compressed { data, .. } => data.into_owned(),
            }),
            Ok(_) => Err(DatasetError::content(&self.path, "expected a picture")),
            Err(error) => Err(DatasetError::content(&self.path, error.to_string())),
        }
    }
}

impl Pictures for Stored {
    fn pictures(&self, index: usize, _: u64) -> Result<(Color, Depth), DatasetError> {
        let OwnPictures { color, color_format, depth, depth_format } = self.frames[index];
        Ok((
            Color { format: color_format, bytes: self.pixels(color)? },
            Depth { format: depth_format, bytes: self.pixels(depth)? },
        ))
    }
}

fn cameras(open: &v1::OpenMap) -> Option<Cameras> {
    let color = Camera {
        intrinsics: intrinsics(open.intrinsics.as_ref()?),
        distortion: distortion(open.distortion.as_ref())?,
    };
    let depth = match &open.depth_camera {
        None => None,
        Some(depth) => Some(depth_camera(depth)?),
    };
    let range = [open.min_depth_metres, open.max_depth_metres];
    Some(Cameras {
        color,
        depth,
        depth_range_metres: (range != [0.0; 2]).then_some(range),
        no_depth: open.no_depth.iter().filter_map(|value| u16::try_from(*value).ok()).collect(),
        up: open.up.as_ref().map(vector),
    })
}

fn depth_camera(depth: &v1::DepthCamera) -> Option<DepthCamera> {
    let own = intrinsics(depth.intrinsics.as_ref()?);
    if [own.fx, own.fy, own.cx, own.cy] == [0.0; 4] {
        return Some(DepthCamera::SameLens { width: own.width, height: own.height });
    }
    let color_from_depth = match &depth.color_from_depth {
        None => Isometry3::identity(),
        Some(given) => pose(given)?,
    };
    let distortion = distortion(depth.distortion.as_ref())?;
    Some(DepthCamera::Own { camera: Camera { intrinsics: own, distortion }, color_from_depth })
}

fn distortion(found: Option<&v1::Distortion>) -> Option<Distortion> {
    let Some(found) = found else { return Some(Distortion::None) };
    let coefficients = &found.coefficients;
    match found.model() {
        v1::DistortionModel::Unspecified => Some(Distortion::None),
        v1::DistortionModel::BrownConrady => Some(Distortion::BrownConrady(coefficients.clone())),
        v1::DistortionModel::KannalaBrandt => {
            coefficients[..].try_into().ok().map(Distortion::KannalaBrandt)
        }
    }
}

fn intrinsics(found: &v1::Intrinsics) -> Intrinsics {
    let v1::Intrinsics { width, height, fx, fy, cx, cy } = *found;
    Intrinsics { width, height, fx, fy, cx, cy }
}

fn vector(found: &v1::Vector3) -> [f64; 3] {
    [found.x, found.y, found.z]
}

fn pose(found: &v1::Pose) -> Option<Isometry3<f64>> {
    let (q, t) = (found.rotation?, found.translation_metres?);
    let quaternion = Quaternion::new(q.w, q.x, q.y, q.z);
    // The bits that were sent, if they are a rotation.
    let is_unit = (quaternion.norm() - 1.0).abs() < 1e-9;
    let normalized = || UnitQuaternion::try_new(quaternion, 1e-6);
    let rotation = if is_unit { UnitQuaternion::new_unchecked(quaternion) } else { normalized()? };
    Some(Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), rotation))
}
