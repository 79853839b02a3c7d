//! Finding the decoder of a message.

use super::error::MessageError;
use super::reading::Reading;
use super::{cdr, foxglove};

/// Reads the messages of one schema in one encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decoder(Schema);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Schema {
    Ros(cdr::Schema),
    Foxglove(foxglove::Wire, foxglove::Schema),
}

/// What the messages of a schema are about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// [`Reading::Picture`].
    Picture,
    /// [`Reading::Calibration`].
    Calibration,
    /// [`Reading::Transforms`] of a tree of coordinates.
    Transforms,
    /// [`Reading::Transforms`], one each: where the robot is.
    Odometry,
    /// [`Reading::Pose`].
    Pose,
    /// [`Reading::Gravity`].
    Imu,
}

impl Decoder {
    /// The decoder of an encoding (`cdr`, `protobuf` or `json`) and a schema (`sensor_msgs/msg/Image`,
    /// `foxglove.RawImage`, …); `None` if such messages are not read.
    pub fn of(encoding: &str, schema: &str) -> Option<Self> {
        let foxglove = |wire| Some(Self(Schema::Foxglove(wire, foxglove::Schema::of(schema)?)));
        match encoding {
            "cdr" => cdr::Schema::of(schema).map(|schema| Self(Schema::Ros(schema))),
            "protobuf" => foxglove(foxglove::Wire::Protobuf),
            "json" => foxglove(foxglove::Wire::Json),
            _ => None,
        }
    }

    /// The schema's name.
    pub fn schema(self) -> &'static str {
        match self.0 {
            Schema::Ros(schema) => schema.name(),
            Schema::Foxglove(_, schema) => schema.name(),
        }
    }

    /// Whether messages follow ROS's conventions: worlds have z up (REP 103).
    pub fn is_ros(self) -> bool {
        matches!(self.0, Schema::Ros(_))
    }

    /// What the messages are about.
    pub fn kind(self) -> Kind {
        use cdr::Schema as Ros;
        use foxglove::Schema as Foxglove;
        match self.0 {
            Schema::Ros(Ros::Image | Ros::CompressedImage)
            | Schema::Foxglove(_, Foxglove::RawImage | Foxglove::CompressedImage) => Kind::Picture,
            Schema::Ros(Ros::CameraInfo) | Schema::Foxglove(_, Foxglove::CameraCalibration) => {
                Kind::Calibration
            }
            Schema::Ros(Ros::TfMessage)
            | Schema::Foxglove(_, Foxglove::FrameTransform | Foxglove::FrameTransforms) => {
                Kind::Transforms
            }
            Schema::Ros(Ros::Odometry | Ros::TransformStamped) => Kind::Odometry,
            Schema::Ros(Ros::PoseStamped | Ros::PoseWithCovarianceStamped)
            | Schema::Foxglove(_, Foxglove::PoseInFrame) => Kind::Pose,
            Schema::Ros(Ros::Imu) => Kind::Imu,
        }
    }

    /// What a message says.
    ///
    /// # Errors
    /// [`MessageError`] if the bytes are no such message, or a value cannot be used.
    pub fn read(self, data: &[u8]) -> Result<Reading<'_>, MessageError> {
        match self.0 {
            Schema::Ros(schema) => schema.read(data),
            Schema::Foxglove(wire, schema) => schema.read(wire, data),
        }
    }
}
