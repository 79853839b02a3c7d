//! Foxglove's own messages, in protobuf or JSON.

use super::calibration::{Calibration, Region};
use super::error::MessageError;
use super::picture::{Picture, Pixels};
use super::reading::{self, Posed, Reading, Transform};
use foxglove::messages::{
    CameraCalibration, CompressedImage, FrameTransform, FrameTransforms, PoseInFrame, Quaternion,
    RawImage, Timestamp, Vector3,
};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::borrow::Cow;

/// A schema of Foxglove that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Schema {
    RawImage,
    CompressedImage,
    CameraCalibration,
    FrameTransform,
    FrameTransforms,
    PoseInFrame,
}

/// How messages are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wire {
    Protobuf,
    Json,
}

impl Schema {
    const ALL: [Self; 6] = [
        Self::RawImage,
        Self::CompressedImage,
        Self::CameraCalibration,
        Self::FrameTransform,
        Self::FrameTransforms,
        Self::PoseInFrame,
    ];

    /// By its name.
    pub(super) fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|schema| schema.name() == name)
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::RawImage => "foxglove.RawImage",
            Self::CompressedImage => "foxglove.CompressedImage",
            Self::CameraCalibration => "foxglove.CameraCalibration",
            Self::FrameTransform => "foxglove.FrameTransform",
            Self::FrameTransforms => "foxglove.FrameTransforms",
            Self::PoseInFrame => "foxglove.PoseInFrame",
        }
    }

    pub(super) fn read(self, wire: Wire, data: &[u8]) -> Result<Reading<'static>, MessageError> {
        Ok(match self {
            Self::RawImage => Reading::Picture(raw(self.decoded(wire, data)?)),
            Self::CompressedImage => {
                let image: CompressedImage = self.decoded(wire, data)?;
                let (nanos, frame_id) = (nanos(image.timestamp), image.frame_id);
                let data = Cow::Owned(image.data.into());
                let pixels = Pixels::Compressed { format: image.format, data };
                Reading::Picture(Picture { nanos, frame_id, pixels })
            }
            Self::CameraCalibration => {
                Reading::Calibration(calibration(self.decoded(wire, data)?)?)
            }
            Self::FrameTransform => {
                Reading::Transforms(vec![transform(self.decoded(wire, data)?)?])
            }
            Self::FrameTransforms => {
                let all: FrameTransforms = self.decoded(wire, data)?;
                let read = all.transforms.into_iter().map(transform);
                Reading::Transforms(read.collect::<Result<_, _>>()?)
            }
            Self::PoseInFrame => {
                let PoseInFrame { timestamp, frame_id, pose } = self.decoded(wire, data)?;
                let pose = pose.unwrap_or_default();
                let pose = rigid(pose.position, pose.orientation)?;
                Reading::Pose(Posed { nanos: nanos(timestamp), frame_id, pose })
            }
        })
    }

    fn decoded<T: prost::Message + DeserializeOwned + Default>(
        self,
        wire: Wire,
        data: &[u8],
    ) -> Result<T, MessageError> {
        let damaged = |reason: String| MessageError::damaged(self.name(), reason);
        match wire {
            Wire::Protobuf => T::decode(data).map_err(|error| damaged(error.to_string())),
            Wire::Json if self == Self::CameraCalibration => {
                let value = serde_json::from_slice(data).map_err(|e| damaged(e.to_string()))?;
                serde_json::from_value(lower_case(value)).map_err(|e| damaged(e.to_string()))
            }
            Wire::Json => serde_json::from_slice(data).map_err(|error| damaged(error.to_string())),
        }
    }
}

/// The JSON schema of calibrations calls its matrices `D`, `K`, `R` and `P`; in protobuf they are `d`, `k`,
/// ….
fn lower_case(value: Value) -> Value {
    let Value::Object(fields) = value else { return value };
    fields.into_iter().map(|(name, value)| (name.to_lowercase(), value)).collect()
}

fn nanos(timestamp: Option<Timestamp>) -> u64 {
    timestamp.map_or(0, |time| u64::from(time.sec()) * 1_000_000_000 + u64::from(time.nsec()))
}

fn raw(image: RawImage) -> Picture<'static> {
    let pixels = Pixels::Raw {
        width: image.width,
        height: image.height,
        encoding: image.encoding,
        step: image.step,
        is_big_endian: false,
        data: Cow::Owned(image.data.into()),
    };
    Picture { nanos: nanos(image.timestamp), frame_id: image.frame_id, pixels }
}

fn calibration(found: CameraCalibration) -> Result<Calibration, MessageError> {
    Ok(Calibration {
        frame_id: found.frame_id,
        width: found.width,
        height: found.height,
        distortion_model: found.distortion_model,
        d: found.d,
        k: matrix("K", &found.k)?,
        p: if found.p.is_empty() { [0.0; 12] } else { matrix("P", &found.p)? },
        binning: [1, 1],
        region: Region::default(),
    })
}

fn matrix<const N: usize>(name: &str, numbers: &[f64]) -> Result<[f64; N], MessageError> {
    numbers.try_into().map_err(|_| {
        let found = numbers.len();
        MessageError::content(format!("{name}: expected {N} numbers, found {found}"))
    })
}

fn transform(found: FrameTransform) -> Result<Transform, MessageError> {
    Ok(Transform {
        nanos: nanos(found.timestamp),
        parent_from_child: rigid(found.translation, found.rotation)?,
        parent: found.parent_frame_id,
        child: found.child_frame_id,
    })
}

/// A message without a rotation has none.
fn rigid(
    translation: Option<Vector3>,
    rotation: Option<Quaternion>,
) -> Result<nalgebra::Isometry3<f64>, MessageError> {
    let Vector3 { x, y, z } = translation.unwrap_or_default();
    let q = rotation.unwrap_or(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
    reading::rigid([x, y, z], [q.x, q.y, q.z, q.w])
}
