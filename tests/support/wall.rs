//! A robot in front of a wall: small frames that cost a server next to nothing.

use lexsplat_proto::v1::{self, FrameMessage, frame_message::Message};

/// Columns of a frame.
pub const WIDTH: u32 = 32;
/// Rows.
pub const HEIGHT: u32 = 24;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;
/// Between two frames. So little that hardly one becomes a keyframe.
pub const STEP_METRES: f64 = 1e-4;

/// The message that opens a map.
pub fn open(map: &str) -> FrameMessage {
    let open = v1::OpenMap {
        map: map.into(),
        intrinsics: Some(v1::Intrinsics {
            width: WIDTH,
            height: HEIGHT,
            fx: 30.0,
            fy: 30.0,
            cx: 15.5,
            cy: 11.5,
        }),
        depth_unit_metres: 0.001,
        pose_source: v1::PoseSource::Given.into(),
        label_texts: vec!["wall".into()],
        ..v1::OpenMap::default()
    };
    FrameMessage { message: Some(Message::Open(open)) }
}

/// Colors that say which frame it is.
pub fn colors(sequence: u64) -> Vec<u8> {
    let mut colors: Vec<u8> = (0..3 * PIXELS).map(|at| (at * 7 + at / 32 * 13) as u8).collect();
    colors[..8].copy_from_slice(&sequence.to_le_bytes());
    colors
}

/// A wall 2 m away, with one label for all of it, so that no network has to look at it.
pub fn frame(sequence: u64) -> v1::Frame {
    v1::Frame {
        sequence,
        timestamp_nanos: 1 + sequence * 33_333_333,
        color_format: v1::ColorFormat::Rgb8.into(),
        color: colors(sequence).into(),
        depth_format: v1::DepthFormat::U16.into(),
        depth: 2000_u16.to_le_bytes().repeat(PIXELS).into(),
        label_format: v1::LabelFormat::U16.into(),
        labels: 1_u16.to_le_bytes().repeat(PIXELS).into(),
        world_from_camera: Some(v1::Pose {
            rotation: Some(v1::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 }),
            translation_metres: Some(v1::Vector3 {
                x: STEP_METRES * sequence as f64,
                y: 0.0,
                z: 0.0,
            }),
        }),
        ..v1::Frame::default()
    }
}
