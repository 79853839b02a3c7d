//! A robot in a synthetic room: what it sends, and what is true of what it saw.

use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_synthetic::{self as synthetic, Camera, Room, View};
use nalgebra::{Isometry3, Point3};

/// Columns of what the robot sees.
const WIDTH: u32 = 320;
/// Rows.
const HEIGHT: u32 = 240;
/// Metres per unit of its 16-bit depth images.
const DEPTH_UNIT_METRES: f64 = 1.0 / 6553.5;
/// How far beside a thing's box the centre of what is found may lie.
const BOX_MARGIN_METRES: f64 = 0.1;
/// Between frames.
const FRAME_NANOS: u64 = 33_333_333;

/// A walk through a room, rendered.
pub struct Robot {
    /// The room.
    pub room: Room,
    /// The camera.
    pub camera: Camera,
    /// `world_from_camera` of each frame.
    pub poses: Vec<Isometry3<f64>>,
    /// What each frame shows.
    pub views: Vec<View>,
}

impl Robot {
    /// Walks through the room of that seed.
    pub fn new(seed: u64, frames: usize) -> Self {
        Self::with(seed, frames, Camera::new(WIDTH, HEIGHT))
    }

    /// The same walk with this camera.
    pub fn with(seed: u64, frames: usize, camera: Camera) -> Self {
        let room = Room::new(seed);
        let poses = room.path(frames);
        let views = poses.iter().map(|pose| room.render(&camera, pose)).collect();
        Self { room, camera, poses, views }
    }

    /// The message that opens a map.
    pub fn open(&self, map: &str) -> v1::FrameMessage {
        let Camera { width, height, fx, fy, cx, cy } = self.camera;
        let open = v1::OpenMap {
            map: map.into(),
            intrinsics: Some(v1::Intrinsics { width, height, fx, fy, cx, cy }),
            depth_unit_metres: DEPTH_UNIT_METRES,
            pose_source: v1::PoseSource::Given.into(),
            ..v1::OpenMap::default()
        };
        v1::FrameMessage { message: Some(Message::Open(open)) }
    }

    /// A frame as a robot sends it: JPEG and 16-bit PNG.
    pub fn frame(&self, at: usize) -> v1::Frame {
        let view = &self.views[at];
        v1::Frame {
            sequence: at as u64,
            timestamp_nanos: at as u64 * FRAME_NANOS,
            color_format: v1::ColorFormat::Jpeg.into(),
            color: synthetic::jpeg(view).expect("it encodes").into(),
            depth_format: v1::DepthFormat::Png16.into(),
            depth: synthetic::depth_png(view).expect("it encodes").into(),
            world_from_camera: Some(pose(&self.poses[at])),
            pose_covariance: Vec::new(),
            ..v1::Frame::default()
        }
    }

    /// The opening message and every frame.
    pub fn messages(&self, map: &str) -> Vec<v1::FrameMessage> {
        self.stream(map, (0..self.views.len()).map(|at| self.frame(at)))
    }

    /// The opening message and these frames.
    pub fn stream(
        &self,
        map: &str,
        frames: impl IntoIterator<Item = v1::Frame>,
    ) -> Vec<v1::FrameMessage> {
        let message = |frame| v1::FrameMessage { message: Some(Message::Frame(frame)) };
        std::iter::once(self.open(map)).chain(frames.into_iter().map(message)).collect()
    }

    /// The same where poses are to be estimated: only frame 0 says where it was taken.
    pub fn stream_without_poses(
        &self,
        map: &str,
        frames: impl IntoIterator<Item = v1::Frame>,
    ) -> Vec<v1::FrameMessage> {
        let mut messages = self.stream(map, frames);
        for message in &mut messages {
            match &mut message.message {
                Some(Message::Open(open)) => open.set_pose_source(v1::PoseSource::Estimated),
                Some(Message::Frame(frame)) if frame.sequence > 0 => frame.world_from_camera = None,
                _ => {}
            }
        }
        messages
    }

    /// Metres between where a view was taken and where an acknowledgement says; infinite if it says nothing.
    pub fn error(&self, ack: &v1::FrameAck, view: usize) -> f64 {
        let found = ack.world_from_camera.as_ref().and_then(|pose| pose.translation_metres);
        found.map_or(f64::INFINITY, |at| {
            let wanted = self.poses[view].translation.vector.into();
            nalgebra::distance(&Point3::new(at.x, at.y, at.z), &wanted)
        })
    }

    /// The opening message and every frame with its instances as labels, which stand for their classes.
    pub fn labelled_messages(&self, map: &str) -> Vec<v1::FrameMessage> {
        let mut messages = self.messages(map);
        for message in &mut messages {
            match &mut message.message {
                Some(Message::Open(open)) => {
                    let classes = self.room.instances().iter().map(|thing| thing.class.to_owned());
                    open.label_texts = classes.collect();
                }
                Some(Message::Frame(frame)) => {
                    let view = &self.views[frame.sequence as usize];
                    frame.set_label_format(v1::LabelFormat::Png);
                    frame.labels = synthetic::mask_png(view).expect("it encodes").into();
                }
                None => {}
            }
        }
        messages
    }

    /// The class at a pixel of a frame.
    pub fn class_at(&self, frame: usize, column: u32, row: u32) -> Option<&'static str> {
        let id = self.views[frame].instances[(row * WIDTH + column) as usize];
        let at = usize::from(id).checked_sub(1)?;
        Some(self.room.instances()[at].class)
    }

    /// Whether a point of the world lies in the box of a thing of that class, or at most
    /// `BOX_MARGIN_METRES` beside it.
    pub fn is_in(&self, class: &str, point: [f32; 3]) -> bool {
        self.room.instances().iter().filter(|thing| thing.class == class).any(|thing| {
            (0..3).all(|axis| {
                let at = f64::from(point[axis]);
                at >= thing.aabb_min[axis] - BOX_MARGIN_METRES
                    && at <= thing.aabb_max[axis] + BOX_MARGIN_METRES
            })
        })
    }

    /// Pixels of a class in a frame.
    pub fn pixels_of(&self, frame: usize, class: &str) -> usize {
        let instances = self.room.instances();
        let is_class = |id: &&u8| **id > 0 && instances[usize::from(**id) - 1].class == class;
        self.views[frame].instances.iter().filter(is_class).count()
    }
}

/// A pose on the wire.
fn pose(world_from_camera: &Isometry3<f64>) -> v1::Pose {
    let (q, t) = (world_from_camera.rotation, world_from_camera.translation);
    v1::Pose {
        rotation: Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k }),
        translation_metres: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
    }
}

/// A frame without any compression: raw RGB and metres, 0.54 MB.
pub fn raw(robot: &Robot, at: usize) -> v1::Frame {
    let view = &robot.views[at];
    v1::Frame {
        color_format: v1::ColorFormat::Rgb8.into(),
        color: view.rgb.clone().into(),
        depth_format: v1::DepthFormat::F32Metres.into(),
        depth: view.depth.iter().flat_map(|metres| metres.to_le_bytes()).collect::<Vec<_>>().into(),
        ..robot.frame(at)
    }
}
