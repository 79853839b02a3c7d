//! What the server says about input that is probably wrong: a kind and a sentence for people.
//!
//! A warning changes nothing: frames are accepted and mapped as they are.

use serde::{Deserialize, Serialize};

/// What is probably wrong with the frames of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InputProblem {
    /// Depth is in another unit than the server was told, or than the poses.
    DepthUnit,
    /// Poses are `camera_from_world` instead of `world_from_camera`.
    InvertedPoses,
    /// Poses are of axes other than x right, y down, z forward.
    CameraAxes,
    /// Depth does not lie on the color image.
    UnregisteredDepth,
    /// Depth stays the same while color changes.
    RepeatedDepth,
    /// The first frames could not be tracked together with later ones: the map began anew.
    BadBeginning,
    /// No frame so far has any depth.
    NoDepth,
}

impl InputProblem {
    /// The name in statuses, events and logs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::DepthUnit => "depth_unit",
            Self::InvertedPoses => "inverted_poses",
            Self::CameraAxes => "camera_axes",
            Self::UnregisteredDepth => "unregistered_depth",
            Self::RepeatedDepth => "repeated_depth",
            Self::BadBeginning => "bad_beginning",
            Self::NoDepth => "no_depth",
        }
    }
}

/// A warning about the frames of a stream.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputWarning {
    /// What is wrong.
    pub problem: InputProblem,
    /// What is wrong, how sure that is, and what to do, in plain English.
    pub message: String,
}

impl InputWarning {
    /// The map was emptied and begins with the frame of this sequence number.
    pub(crate) fn bad_beginning(sequence: u64) -> Self {
        let message = format!(
            "The first frames of the map could not be tracked together with those that came after: it was emptied \
             and begins anew with frame {sequence}. Over-exposed or dark pictures, or a hand before the lens, look \
             like that."
        );
        Self { problem: InputProblem::BadBeginning, message }
    }
}
