//! RGB-D **data sets**: folders in several layouts and the synthetic room behind one trait.
//!
//! In: a [`DatasetSpec`] such as `replica:room7`. Out: frames as the server takes them: color as
//! JPEG or PNG bytes, depth as 16-bit PNG bytes in units of
//! [`Dataset::depth_unit_metres`], `world_from_camera` in metres (camera x right, y down,
//! z forward). What is ground truth about things, not needed for mapping, is [`Truth`]. One file per
//! layout; nothing here talks to a server.

mod error;
mod files;
mod kinect;
mod pose;
mod range;
mod replica;
mod seven_scenes;
mod spec;
mod synthetic;
mod tum;

pub use error::DatasetError;
pub use range::FrameRange;
pub use spec::DatasetSpec;

pub use lexsplat_proto::v1::{ColorFormat, DepthFormat};
use nalgebra::Isometry3;

/// A pinhole camera, pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Focal length, pixels.
    pub fx: f64,
    /// Focal length, pixels.
    pub fy: f64,
    /// Principal point, pixels.
    pub cx: f64,
    /// Principal point, pixels.
    pub cy: f64,
}

/// A color picture as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Color {
    /// How the bytes are to be read.
    pub format: ColorFormat,
    /// The file's bytes.
    pub bytes: Vec<u8>,
}

/// A depth picture; 0 is no measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// How the bytes are to be read.
    pub format: DepthFormat,
    /// The file's bytes.
    pub bytes: Vec<u8>,
}

/// Color, depth registered to it, and where it was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    /// The frame's number in the data set, strictly increasing.
    pub sequence: u64,
    /// When it was taken; layouts without times count 30 frames per second from 0.
    pub timestamp_nanos: u64,
    /// The picture.
    pub color: Color,
    /// The depth of the same pixels.
    pub depth: Depth,
    /// The pose, metres; absent if the data set has none.
    pub world_from_camera: Option<Isometry3<f64>>,
}

/// A sequence of RGB-D frames of one camera.
pub trait Dataset: Send + Sync {
    /// A short name to call its map by, such as `room7`.
    fn name(&self) -> &str;

    /// Number of frames.
    fn len(&self) -> usize;

    /// Whether there are no frames; those opened by a [`DatasetSpec`] have some.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The camera.
    fn intrinsics(&self) -> Intrinsics;

    /// Metres per unit of depth.
    fn depth_unit_metres(&self) -> f64;

    /// The number of frame `index` (below [`Dataset::len`]), without reading it.
    fn sequence(&self, index: usize) -> u64;

    /// Reads or renders frame `index` (below [`Dataset::len`]).
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError>;

    /// Why frames were left out when the data set was opened, one line per frame.
    fn skipped(&self) -> &[String] {
        &[]
    }

    /// What is known about the things in the scene.
    fn truth(&self) -> Option<&dyn Truth> {
        None
    }
}

/// One thing in a scene.
#[derive(Clone, Debug, PartialEq, serde::Deserialize)]
pub struct Instance {
    /// Value in the masks, from 1.
    pub id: u16,
    /// Unique name, such as `chair_2`.
    pub name: String,
    /// Class name, such as `chair`.
    pub class: String,
    /// Smallest corner of its bounding box in the world, metres.
    pub aabb_min: [f64; 3],
    /// Largest corner.
    pub aabb_max: [f64; 3],
}

/// Which thing each pixel of a frame shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// [`Instance::id`] per pixel, row by row; 0 is none.
    pub ids: Vec<u16>,
}

/// Ground truth about things.
pub trait Truth: Send + Sync {
    /// Everything in the scene.
    fn instances(&self) -> &[Instance];

    /// Which thing each pixel of frame `index` of the data set shows.
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    fn mask(&self, index: usize) -> Result<Mask, DatasetError>;

    /// The classes of things, each once, without what makes up the room itself.
    fn classes(&self) -> Vec<String> {
        let mut classes: Vec<String> = Vec::new();
        for Instance { class, .. } in self.instances() {
            if !STRUCTURE.contains(&class.as_str()) && !classes.contains(class) {
                classes.push(class.clone());
            }
        }
        classes
    }
}

/// Classes that make up a room.
const STRUCTURE: [&str; 4] = ["wall", "floor", "ceiling", "room"];
/// Frames per second of layouts without times.
const FRAMES_PER_SECOND: u64 = 30;

/// The time of frame number `sequence` in a layout without times.
fn counted_nanos(sequence: u64) -> u64 {
    sequence.saturating_mul(1_000_000_000) / FRAMES_PER_SECOND
}

#[cfg(test)]
mod tests;
