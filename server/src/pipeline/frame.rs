//! What goes through the pipeline: a checked RGB-D frame and what became of it.
//!
//! A [`Frame`] is only made by `ingest`, which has checked everything about it; nothing behind that
//! edge checks again. Wire types never get here.

use nalgebra::{Isometry3, Matrix6};
use std::sync::Arc;

/// Pinhole intrinsics in pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length in x, pixels, > 0.
    pub fx: f64,
    /// Focal length in y, pixels, > 0.
    pub fy: f64,
    /// Principal point, column.
    pub cx: f64,
    /// Principal point, row.
    pub cy: f64,
}

impl Intrinsics {
    /// The rasteriser's camera at `world_from_camera`.
    pub fn camera(&self, world_from_camera: &Isometry3<f64>) -> lexsplat_gpu::Camera {
        lexsplat_gpu::Camera {
            width: self.width,
            height: self.height,
            fx: self.fx as f32,
            fy: self.fy as f32,
            cx: self.cx as f32,
            cy: self.cy as f32,
            camera_from_world: world_from_camera.inverse().cast(),
        }
    }
}

/// One checked RGB-D frame: color and depth are registered and of the size of `intrinsics`.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Strictly increasing within a map.
    pub sequence: u64,
    /// When it was taken.
    pub timestamp_nanos: u64,
    /// The camera.
    pub intrinsics: Intrinsics,
    /// `[height * width * 3]`, row-major RGB, 8 bit.
    pub rgb: Arc<[u8]>,
    /// `[height * width]`, camera z in metres; 0 is no measurement, nothing is NaN or infinite.
    pub depth_metres: Arc<[f32]>,
    /// The given pose, rigid and finite; `None` if the server is to track.
    pub world_from_camera: Option<Isometry3<f64>>,
    /// What the robot thinks, where the server is to track.
    pub hint: Option<Box<PoseHint>>,
    /// What the robot says that it shows; `None`: the networks are to look.
    pub labels: Option<Labels>,
    /// Whether it is only tracked and never a keyframe.
    pub held_out: bool,
}

/// Language that is given: a text for each pixel.
#[derive(Clone, Debug)]
pub struct Labels {
    /// `[height * width]`; 0 is none, n is `texts[n - 1]`; none is greater than there are texts.
    pub ids: Arc<[u16]>,
    /// What labels stand for; an empty text says nothing.
    pub texts: Arc<[String]>,
}

/// Where a robot thinks that it is.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseHint {
    /// The pose, rigid and finite.
    pub world_from_camera: Isometry3<f64>,
    /// Covariance of a left perturbation [rho metres, theta radians], finite, symmetric, with no
    /// negative eigenvalue; `None`: no more than a place to put a map's first frame.
    pub covariance: Option<Matrix6<f64>>,
}

/// What the tracker says of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackingState {
    /// No frame yet.
    Empty,
    /// The newest frame has a pose.
    Tracking,
    /// The newest frame has none.
    Lost,
}

impl TrackingState {
    /// The name in statuses and events.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::Tracking => "tracking",
            Self::Lost => "lost",
        }
    }
}

/// What became of one frame.
#[derive(Clone, Debug)]
pub struct FrameOutcome {
    /// The frame's sequence.
    pub sequence: u64,
    /// Whether it has a pose.
    pub tracking: TrackingState,
    /// Whether the frame before had none, so that the pose was found anew.
    pub relocalised: bool,
    /// Its pose, if tracked.
    pub world_from_camera: Option<Isometry3<f64>>,
    /// Whether the map took it as a keyframe.
    pub keyframe: bool,
    /// The map's revision after it.
    pub revision: u64,
}
