//! Messages of ROS 2, in CDR: `sensor_msgs`, `tf2_msgs`, `nav_msgs` and `geometry_msgs`.
//!
//! Structs have the fields of the `.msg` files in their order, up to the last that is used. Pictures are
//! borrowed from the message.

use super::calibration::{Calibration, Region};
use super::error::MessageError;
use super::picture::{Picture, Pixels};
use super::reading::{self, Posed, Reading, Transform};
use byteorder::{BigEndian, LittleEndian};
use serde::Deserialize;
use std::borrow::Cow;

#[derive(Deserialize)]
struct Time {
    sec: i32,
    nanosec: u32,
}

impl Time {
    fn nanos(&self) -> u64 {
        u64::try_from(self.sec).unwrap_or(0) * 1_000_000_000 + u64::from(self.nanosec)
    }
}

#[derive(Deserialize)]
struct Header {
    stamp: Time,
    frame_id: String,
}

#[derive(Deserialize)]
struct Image<'a> {
    header: Header,
    height: u32,
    width: u32,
    encoding: String,
    is_bigendian: u8,
    step: u32,
    data: &'a [u8],
}

#[derive(Deserialize)]
struct CompressedImage<'a> {
    header: Header,
    format: String,
    data: &'a [u8],
}

#[derive(Deserialize)]
struct RegionOfInterest {
    x_offset: u32,
    y_offset: u32,
    height: u32,
    width: u32,
}

#[derive(Deserialize)]
struct CameraInfo {
    header: Header,
    height: u32,
    width: u32,
    distortion_model: String,
    d: Vec<f64>,
    k: [f64; 9],
    #[expect(dead_code, reason = "stands between fields that are used")]
    r: [f64; 9],
    p: [f64; 12],
    binning_x: u32,
    binning_y: u32,
    roi: RegionOfInterest,
}

#[derive(Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

impl Vector {
    fn array(&self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

#[derive(Deserialize)]
struct Orientation {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Deserialize)]
struct Pose {
    position: Vector,
    orientation: Orientation,
}

impl Pose {
    fn rigid(&self) -> Result<nalgebra::Isometry3<f64>, MessageError> {
        let Orientation { x, y, z, w } = self.orientation;
        reading::rigid(self.position.array(), [x, y, z, w])
    }
}

#[derive(Deserialize)]
struct TransformStamped {
    header: Header,
    child_frame_id: String,
    transform: Pose,
}

impl TransformStamped {
    fn into_transform(self) -> Result<Transform, MessageError> {
        let parent_from_child = self.transform.rigid()?;
        let Header { stamp, frame_id: parent } = self.header;
        Ok(Transform {
            nanos: stamp.nanos(),
            parent,
            child: self.child_frame_id,
            parent_from_child,
        })
    }
}

#[derive(Deserialize)]
struct TfMessage {
    transforms: Vec<TransformStamped>,
}

/// Also the beginning of PoseWithCovarianceStamped.
#[derive(Deserialize)]
struct PoseStamped {
    header: Header,
    pose: Pose,
}

#[derive(Deserialize)]
struct Odometry {
    header: Header,
    child_frame_id: String,
    pose: Pose,
}

#[derive(Deserialize)]
#[expect(dead_code, reason = "fields stand between those that are used")]
struct Imu {
    header: Header,
    orientation: Orientation,
    orientation_covariance: [f64; 9],
    angular_velocity: Vector,
    angular_velocity_covariance: [f64; 9],
    linear_acceleration: Vector,
}

/// A schema of ROS 2 that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Schema {
    Image,
    CompressedImage,
    CameraInfo,
    TfMessage,
    TransformStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Odometry,
    Imu,
}

impl Schema {
    const ALL: [Self; 9] = [
        Self::Image,
        Self::CompressedImage,
        Self::CameraInfo,
        Self::TfMessage,
        Self::TransformStamped,
        Self::PoseStamped,
        Self::PoseWithCovarianceStamped,
        Self::Odometry,
        Self::Imu,
    ];

    /// By the name of its type.
    pub(super) fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|schema| schema.name() == name)
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Image => "sensor_msgs/msg/Image",
            Self::CompressedImage => "sensor_msgs/msg/CompressedImage",
            Self::CameraInfo => "sensor_msgs/msg/CameraInfo",
            Self::TfMessage => "tf2_msgs/msg/TFMessage",
            Self::TransformStamped => "geometry_msgs/msg/TransformStamped",
            Self::PoseStamped => "geometry_msgs/msg/PoseStamped",
            Self::PoseWithCovarianceStamped => "geometry_msgs/msg/PoseWithCovarianceStamped",
            Self::Odometry => "nav_msgs/msg/Odometry",
            Self::Imu => "sensor_msgs/msg/Imu",
        }
    }

    pub(super) fn read(self, data: &[u8]) -> Result<Reading<'_>, MessageError> {
        Ok(match self {
            Self::Image => Reading::Picture(image(self.decoded(data)?)),
            Self::CompressedImage => {
                let CompressedImage { header, format, data } = self.decoded(data)?;
                let pixels = Pixels::Compressed { format, data: Cow::Borrowed(data) };
                let Header { stamp, frame_id } = header;
                Reading::Picture(Picture { nanos: stamp.nanos(), frame_id, pixels })
            }
            Self::CameraInfo => Reading::Calibration(calibration(self.decoded(data)?)),
            Self::TfMessage => {
                let TfMessage { transforms } = self.decoded(data)?;
                let read = transforms.into_iter().map(TransformStamped::into_transform);
                Reading::Transforms(read.collect::<Result<_, _>>()?)
            }
            Self::TransformStamped => {
                let transform: TransformStamped = self.decoded(data)?;
                Reading::Transforms(vec![transform.into_transform()?])
            }
            Self::PoseStamped | Self::PoseWithCovarianceStamped => {
                let PoseStamped { header, pose } = self.decoded(data)?;
                let Header { stamp, frame_id } = header;
                Reading::Pose(Posed { nanos: stamp.nanos(), frame_id, pose: pose.rigid()? })
            }
            Self::Odometry => {
                let Odometry { header, child_frame_id, pose } = self.decoded(data)?;
                let pose = TransformStamped { header, child_frame_id, transform: pose };
                Reading::Transforms(vec![pose.into_transform()?])
            }
            Self::Imu => {
                let Imu { header, linear_acceleration, .. } = self.decoded(data)?;
                let Header { stamp, frame_id } = header;
                let acceleration = linear_acceleration.array();
                Reading::Gravity(reading::gravity(stamp.nanos(), frame_id, acceleration))
            }
        })
    }

    /// The struct in a message, whose first four bytes say the order of bytes.
    fn decoded<'a, T: Deserialize<'a>>(self, data: &'a [u8]) -> Result<T, MessageError> {
        let decoded = match data {
            [0, 0, _, _, body @ ..] => cdr_encoding::from_bytes::<T, BigEndian>(body),
            [0, 1, _, _, body @ ..] => cdr_encoding::from_bytes::<T, LittleEndian>(body),
            [first, second, _, _, ..] => {
                let reason = format!("expected plain CDR, found encapsulation {first} {second}");
                return Err(MessageError::damaged(self.name(), reason));
            }
            _ => return Err(MessageError::damaged(self.name(), "unexpected end")),
        };
        decoded.map(|(value, _)| value).map_err(|e| MessageError::damaged(self.name(), e))
    }
}

fn image(image: Image<'_>) -> Picture<'_> {
    let Header { stamp, frame_id } = image.header;
    let pixels = Pixels::Raw {
        width: image.width,
        height: image.height,
        encoding: image.encoding,
        step: image.step,
        is_big_endian: image.is_bigendian != 0,
        data: Cow::Borrowed(image.data),
    };
    Picture { nanos: stamp.nanos(), frame_id, pixels }
}

fn calibration(info: CameraInfo) -> Calibration {
    let RegionOfInterest { x_offset, y_offset, width, height } = info.roi;
    Calibration {
        frame_id: info.header.frame_id,
        width: info.width,
        height: info.height,
        distortion_model: info.distortion_model,
        d: info.d,
        k: info.k,
        p: info.p,
        binning: [info.binning_x.max(1), info.binning_y.max(1)],
        region: Region { x: x_offset, y: y_offset, width, height },
    }
}
