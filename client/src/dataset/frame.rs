//! An RGB-D frame and the camera that took it.

pub use lexsplat_proto::v1::{ColorFormat, DepthFormat};
use nalgebra::Isometry3;

/// A pinhole camera, pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Column of the principal point, pixels.
    pub cx: f64,
    /// Row of the principal point, pixels.
    pub cy: f64,
}

/// A color image as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Color {
    /// Encoding of the bytes.
    pub format: ColorFormat,
    /// The encoded image.
    pub bytes: Vec<u8>,
}

/// A depth image as it is stored; 0 and 65535 are no measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// Encoding of the bytes.
    pub format: DepthFormat,
    /// The encoded image.
    pub bytes: Vec<u8>,
}

/// A color image, the depth of the same pixels and the pose of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    /// The frame's number, strictly increasing in a stream.
    pub sequence: u64,
    /// Time of the exposure, nanoseconds; layouts without times count 30 frames per second from 0.
    pub timestamp_nanos: u64,
    /// The color image.
    pub color: Color,
    /// The depth image, registered to the color image.
    pub depth: Depth,
    /// The camera's pose, metres (camera x right, y down, z forward); absent if it is not known.
    pub world_from_camera: Option<Isometry3<f64>>,
}

/// When and where a frame was taken, without its pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time of the exposure, as in [`RgbdFrame`], nanoseconds.
    pub timestamp_nanos: u64,
    /// The camera's pose, metres; absent if it is not known.
    pub world_from_camera: Option<Isometry3<f64>>,
}

/// Frames per second of layouts without times.
const FRAMES_PER_SECOND: u64 = 30;

/// The timestamp of frame number `sequence` in a layout without times, nanoseconds from 0.
pub fn counted_nanos(sequence: u64) -> u64 {
    sequence.saturating_mul(1_000_000_000) / FRAMES_PER_SECOND
}
