//! Where is the camera? In: a frame. Out: its pose, or that it is lost.
//!
//! Only given poses so far: the robot says where it is and the tracker believes it. Estimating the
//! pose from the map is the next capability and will live here; it must not touch the map.

use super::frame::{Frame, TrackingState};
use nalgebra::Isometry3;

/// Says where each frame was taken.
pub trait Tracker: Send {
    /// The frame's `world_from_camera`, or `None` if it is not known.
    fn track(&mut self, frame: &Frame) -> Option<Isometry3<f64>>;
    /// After the newest frame.
    fn state(&self) -> TrackingState;
}

/// Believes the pose that came with the frame.
pub struct GivenPoses {
    state: TrackingState,
}

impl GivenPoses {
    /// Before the first frame.
    pub fn new() -> Self {
        Self { state: TrackingState::Empty }
    }
}

impl Default for GivenPoses {
    fn default() -> Self {
        Self::new()
    }
}

impl Tracker for GivenPoses {
    fn track(&mut self, frame: &Frame) -> Option<Isometry3<f64>> {
        self.state = match frame.world_from_camera {
            Some(_) => TrackingState::Tracking,
            None => TrackingState::Lost,
        };
        frame.world_from_camera
    }

    fn state(&self) -> TrackingState {
        self.state
    }
}
