//! What a recording contains: the channels of an MCAP file, and frames as messages on them.
//!
//! | topic | schema | contents |
//! |---|---|---|
//! | `/camera/calibration` | `foxglove.CameraCalibration` | the camera, once in each file |
//! | `/camera/color` | `foxglove.CompressedImage` | JPEG or PNG |
//! | `/camera/color_raw` | `foxglove.RawImage` | instead, from a camera that sends pixels |
//! | `/camera/depth`, `/camera/depth_raw` | the same | 16-bit PNG; 16-bit units or metres |
//! | `/camera/pose` | `foxglove.PoseInFrame` | `world_from_camera`, if the robot gave it |
//! | `/lexsplat/open` | `lexsplat.v1.OpenMap` | the opening message, once in each file |
//! | `/lexsplat/frame` | `lexsplat.v1.Frame` | all else of a frame; its images are empty |
//!
//! The messages of a frame follow each other in one chunk; `/lexsplat/frame` is the last of them. Reading
//! gives back the frame that was accepted; only depth that came as zstd comes back without compression.

use foxglove::Encode;
use foxglove::messages::{
    CameraCalibration, CompressedImage, Pose, PoseInFrame, Quaternion, RawImage, Timestamp, Vector3,
};
use lexsplat_proto::DESCRIPTORS;
use lexsplat_proto::v1::{self, frame_message::Message};
use prost::Message as _;
use prost::bytes::Bytes;
use std::borrow::Cow;

/// Name of the coordinate frame of the camera, for tools that show recordings.
const CAMERA: &str = "camera";
/// Name of the coordinate frame of the map.
const MAP: &str = "map";

/// A channel of a recording. Its number is its id in every file, so that a file can be read of which the
/// part that describes the channels is damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    Calibration = 1,
    Color,
    ColorRaw,
    Depth,
    DepthRaw,
    Pose,
    Open,
    Frame,
}

impl Channel {
    const ALL: [Self; 8] = [
        Self::Calibration,
        Self::Color,
        Self::ColorRaw,
        Self::Depth,
        Self::DepthRaw,
        Self::Pose,
        Self::Open,
        Self::Frame,
    ];

    pub(super) fn id(self) -> u16 {
        self as u16
    }

    pub(super) fn from_id(id: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.id() == id)
    }

    pub(super) fn topic(self) -> &'static str {
        match self {
            Self::Calibration => "/camera/calibration",
            Self::Color => "/camera/color",
            Self::ColorRaw => "/camera/color_raw",
            Self::Depth => "/camera/depth",
            Self::DepthRaw => "/camera/depth_raw",
            Self::Pose => "/camera/pose",
            Self::Open => "/lexsplat/open",
            Self::Frame => "/lexsplat/frame",
        }
    }

    /// Name and encoded descriptors of the schema.
    pub(super) fn schema(self) -> (String, Cow<'static, [u8]>) {
        let of = |schema: Option<foxglove::Schema>| {
            let schema = schema.expect("the messages of foxglove have schemas");
            (schema.name, schema.data)
        };
        match self {
            Self::Calibration => of(CameraCalibration::get_schema()),
            Self::Color | Self::Depth => of(CompressedImage::get_schema()),
            Self::ColorRaw | Self::DepthRaw => of(RawImage::get_schema()),
            Self::Pose => of(PoseInFrame::get_schema()),
            Self::Open => ("lexsplat.v1.OpenMap".into(), DESCRIPTORS.into()),
            Self::Frame => ("lexsplat.v1.Frame".into(), DESCRIPTORS.into()),
        }
    }
}

/// A message to write.
pub(super) struct Recorded {
    pub channel: Channel,
    pub data: Vec<u8>,
}

impl Recorded {
    fn new(channel: Channel, message: &impl prost::Message) -> Self {
        Self { channel, data: message.encode_to_vec() }
    }
}

/// Columns and rows of raw images.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    color: (u32, u32),
    depth: (u32, u32),
}

impl Sizes {
    /// The sizes of a stream's images.
    pub(super) fn of(open: &v1::OpenMap) -> Self {
        let color = open.intrinsics.unwrap_or_default();
        let own = open.depth_camera.as_ref().and_then(|camera| camera.intrinsics);
        let depth = own.unwrap_or(color);
        Self { color: (color.width, color.height), depth: (depth.width, depth.height) }
    }
}

/// The messages at the start of a file.
pub(super) fn of_opening(open: &v1::OpenMap) -> Vec<Recorded> {
    let v1::Intrinsics { width, height, fx, fy, cx, cy } = open.intrinsics.unwrap_or_default();
    let lens = open.distortion.clone().unwrap_or_default();
    let distortion_model = match lens.model() {
        v1::DistortionModel::Unspecified => "",
        v1::DistortionModel::BrownConrady if lens.coefficients.len() > 5 => "rational_polynomial",
        v1::DistortionModel::BrownConrady => "plumb_bob",
        v1::DistortionModel::KannalaBrandt => "kannala_brandt",
    };
    let calibration = CameraCalibration {
        frame_id: CAMERA.into(),
        width,
        height,
        distortion_model: distortion_model.into(),
        d: lens.coefficients,
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraCalibration::default()
    };
    vec![Recorded::new(Channel::Open, open), Recorded::new(Channel::Calibration, &calibration)]
}

/// The messages of a frame, in their order.
pub(super) fn of_frame(mut frame: v1::Frame, sizes: Sizes) -> Vec<Recorded> {
    let time = Some(timestamp(frame.timestamp_nanos));
    let mut messages = Vec::with_capacity(4);
    let color = std::mem::take(&mut frame.color);
    messages.push(match frame.color_format() {
        v1::ColorFormat::Rgb8 => raw(Channel::ColorRaw, "rgb8", 3, color, time, sizes.color),
        v1::ColorFormat::Png => compressed(Channel::Color, "png", color, time),
        v1::ColorFormat::Jpeg | v1::ColorFormat::Unspecified => {
            compressed(Channel::Color, "jpeg", color, time)
        }
    });
    if frame.depth_format() == v1::DepthFormat::U16Zstd {
        // The checks have decompressed it once, to exactly this size.
        let bytes = sizes.depth.0 as usize * sizes.depth.1 as usize * 2;
        if let Ok(plain) = zstd::bulk::decompress(&frame.depth, bytes) {
            frame.depth = plain.into();
            frame.set_depth_format(v1::DepthFormat::U16);
        }
    }
    let depth = std::mem::take(&mut frame.depth);
    messages.push(match frame.depth_format() {
        v1::DepthFormat::F32Metres => raw(Channel::DepthRaw, "32FC1", 4, depth, time, sizes.depth),
        v1::DepthFormat::U16 | v1::DepthFormat::U16Zstd => {
            raw(Channel::DepthRaw, "16UC1", 2, depth, time, sizes.depth)
        }
        v1::DepthFormat::Png16 | v1::DepthFormat::Unspecified => {
            compressed(Channel::Depth, "png", depth, time)
        }
    });
    if let Some(pose) = &frame.world_from_camera {
        let pose = PoseInFrame { timestamp: time, frame_id: MAP.into(), pose: Some(pose_of(pose)) };
        messages.push(Recorded::new(Channel::Pose, &pose));
    }
    messages.push(Recorded::new(Channel::Frame, &frame));
    messages
}

fn timestamp(nanos: u64) -> Timestamp {
    let seconds = u32::try_from(nanos / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new(seconds, (nanos % 1_000_000_000) as u32)
}

fn compressed(
    channel: Channel,
    format: &str,
    data: Bytes,
    timestamp: Option<Timestamp>,
) -> Recorded {
    let (frame_id, format) = (CAMERA.into(), format.into());
    Recorded::new(channel, &CompressedImage { timestamp, frame_id, data, format })
}

fn raw(
    channel: Channel,
    encoding: &str,
    pixel_bytes: u32,
    data: Bytes,
    timestamp: Option<Timestamp>,
    (width, height): (u32, u32),
) -> Recorded {
    let image = RawImage {
        timestamp,
        frame_id: CAMERA.into(),
        width,
        height,
        encoding: encoding.into(),
        step: width * pixel_bytes,
        data,
    };
    Recorded::new(channel, &image)
}

fn pose_of(pose: &v1::Pose) -> Pose {
    let t = pose.translation_metres.unwrap_or_default();
    let q = pose.rotation.unwrap_or_default();
    Pose {
        position: Some(Vector3 { x: t.x, y: t.y, z: t.z }),
        orientation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
    }
}

/// Puts frames together from the messages of a file.
#[derive(Default)]
pub(super) struct Assembler {
    color: Bytes,
    depth: Bytes,
}

impl Assembler {
    /// Takes the next message; returns the opening message or the frame that it completes.
    ///
    /// # Errors
    /// [`prost::DecodeError`] if the data is no such message.
    pub(super) fn take(
        &mut self,
        channel: Channel,
        data: &[u8],
    ) -> Result<Option<Message>, prost::DecodeError> {
        match channel {
            Channel::Calibration | Channel::Pose => {}
            Channel::Color => self.color = CompressedImage::decode(data)?.data,
            Channel::ColorRaw => self.color = RawImage::decode(data)?.data,
            Channel::Depth => self.depth = CompressedImage::decode(data)?.data,
            Channel::DepthRaw => self.depth = RawImage::decode(data)?.data,
            Channel::Open => return Ok(Some(Message::Open(v1::OpenMap::decode(data)?))),
            Channel::Frame => {
                let color = std::mem::take(&mut self.color);
                let depth = std::mem::take(&mut self.depth);
                let frame = v1::Frame { color, depth, ..v1::Frame::decode(data)? };
                return Ok(Some(Message::Frame(frame)));
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: v1::Intrinsics =
        v1::Intrinsics { width: 4, height: 2, fx: 3.0, fy: 3.0, cx: 1.5, cy: 0.5 };

    fn back(frame: &v1::Frame) -> v1::Frame {
        let mut assembler = Assembler::default();
        // Depth of another size than color.
        let depth = v1::Intrinsics { width: 2, height: 4, ..CAMERA };
        let depth_camera = v1::DepthCamera { intrinsics: Some(depth), ..Default::default() };
        let open = v1::OpenMap {
            intrinsics: Some(v1::Intrinsics { width: 5, ..CAMERA }),
            depth_camera: Some(depth_camera),
            ..Default::default()
        };
        let messages = of_frame(frame.clone(), Sizes::of(&open));
        let (last, before) = messages.split_last().unwrap();
        for message in before {
            assert!(assembler.take(message.channel, &message.data).unwrap().is_none());
        }
        match assembler.take(last.channel, &last.data).unwrap() {
            Some(Message::Frame(frame)) => frame,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_format_comes_back_as_it_was_accepted() {
        for color in [v1::ColorFormat::Jpeg, v1::ColorFormat::Png, v1::ColorFormat::Rgb8] {
            let depths = [v1::DepthFormat::Png16, v1::DepthFormat::U16, v1::DepthFormat::F32Metres];
            for depth in depths {
                let frame = v1::Frame {
                    sequence: u64::MAX - 1,
                    timestamp_nanos: 5_000_000_007,
                    color_format: color.into(),
                    color: vec![1, 2, 3].into(),
                    depth_format: depth.into(),
                    depth: vec![4, 5].into(),
                    world_from_camera: Some(v1::Pose::default()),
                    pose_covariance: vec![0.5; 36],
                    label_format: v1::LabelFormat::Png.into(),
                    labels: vec![6].into(),
                    held_out: true,
                    intrinsics: Some(CAMERA),
                    depth_timestamp_nanos: 5_000_000_009,
                    up: Some(v1::Vector3 { x: 0.0, y: -1.0, z: 0.1 }),
                };
                assert_eq!(back(&frame), frame);
            }
        }
    }

    #[test]
    fn compressed_depth_comes_back_plain() {
        let plain: Vec<u8> = (0..16).collect();
        let frame = v1::Frame {
            depth_format: v1::DepthFormat::U16Zstd.into(),
            depth: zstd::encode_all(&plain[..], 3).unwrap().into(),
            ..v1::Frame::default()
        };
        let back = back(&frame);
        assert_eq!((back.depth_format(), &back.depth[..]), (v1::DepthFormat::U16, &plain[..]));
    }

    #[test]
    fn an_opening_comes_back_and_channels_are_told_by_their_ids() {
        let open = v1::OpenMap { map: "a".into(), intrinsics: Some(CAMERA), ..Default::default() };
        let mut assembler = Assembler::default();
        let messages = of_opening(&open);
        let first = assembler.take(messages[0].channel, &messages[0].data).unwrap();
        assert_eq!(first, Some(Message::Open(open)));
        for channel in Channel::ALL {
            assert_eq!(Channel::from_id(channel.id()), Some(channel));
        }
        assert_eq!(Channel::from_id(9), None);
    }
}
