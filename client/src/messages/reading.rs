//! What messages say, whatever their schema and encoding.

use super::calibration::Calibration;
use super::error::MessageError;
use super::picture::Picture;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// What a message says. Times are nanoseconds, 0 if the sender did not stamp the message.
#[derive(Clone, Debug, PartialEq)]
pub enum Reading<'a> {
    /// A picture, of color or depth.
    Picture(Picture<'a>),
    /// How a camera projects.
    Calibration(Calibration),
    /// Where frames of coordinates are in one another.
    Transforms(Vec<Transform>),
    /// A pose of something that the message does not name.
    Pose(Posed),
    /// What an IMU says about the direction of gravity; `None` if it is shaken.
    Gravity(Option<Gravity>),
}

impl Reading<'_> {
    /// With the time that the message was received, where the sender set none.
    #[must_use]
    pub fn received(mut self, nanos: u64) -> Self {
        let set = |unset: &mut u64| {
            if *unset == 0 {
                *unset = nanos;
            }
        };
        match &mut self {
            Self::Picture(picture) => set(&mut picture.nanos),
            Self::Transforms(all) => all.iter_mut().for_each(|one| set(&mut one.nanos)),
            Self::Pose(posed) => set(&mut posed.nanos),
            Self::Gravity(Some(gravity)) => set(&mut gravity.nanos),
            Self::Calibration(_) | Self::Gravity(None) => {}
        }
        self
    }
}

/// The pose of one frame of coordinates in another.
#[derive(Clone, Debug, PartialEq)]
pub struct Transform {
    /// When it holds, nanoseconds.
    pub nanos: u64,
    /// The frame that it is given in.
    pub parent: String,
    /// The frame that is placed.
    pub child: String,
    /// Metres.
    pub parent_from_child: Isometry3<f64>,
}

/// A pose in a frame of coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Posed {
    /// When it holds, nanoseconds.
    pub nanos: u64,
    /// The frame that it is given in.
    pub frame_id: String,
    /// Metres.
    pub pose: Isometry3<f64>,
}

/// The direction up at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Gravity {
    /// Nanoseconds.
    pub nanos: u64,
    /// The frame of the IMU.
    pub frame_id: String,
    /// Away from the centre of the earth, in the IMU's coordinates, of length 1.
    pub up: Vector3<f64>,
}

/// Largest departure of a quaternion's length from 1.
const TOLERANCE: f64 = 1e-2;

/// A rigid transform from `x y z` in metres and a quaternion `x y z w`.
///
/// # Errors
/// [`MessageError::Content`] if a number is not finite, or the quaternion's length is not 1.
pub(super) fn rigid(metres: [f64; 3], xyzw: [f64; 4]) -> Result<Isometry3<f64>, MessageError> {
    let [i, j, k, w] = xyzw;
    let quaternion = Quaternion::new(w, i, j, k);
    let norm = quaternion.norm();
    if !metres.iter().chain([&norm]).all(|number| number.is_finite()) {
        return Err(MessageError::content("expected finite numbers in a pose"));
    }
    if (norm - 1.0).abs() > TOLERANCE {
        let reason = format!("expected a quaternion of length 1 in a pose, found length {norm:.3}");
        return Err(MessageError::content(reason));
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    Ok(Isometry3::from_parts(Translation3::from(metres), rotation))
}

/// What a shaken IMU measures differs from this by more than `SHAKEN`, metres per second squared.
const GRAVITY: f64 = 9.81;
const SHAKEN: f64 = 0.6;

/// The direction up, from the acceleration that an IMU measures, metres per second squared.
pub(super) fn gravity(nanos: u64, frame_id: String, acceleration: [f64; 3]) -> Option<Gravity> {
    let acceleration = Vector3::from(acceleration);
    let is_still = (acceleration.norm() - GRAVITY).abs() <= SHAKEN;
    is_still.then(|| Gravity { nanos, frame_id, up: acceleration.normalize() })
}
