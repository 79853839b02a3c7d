//! A ray-cast room with boxes, and a walk through it.

use super::super::super::frame::{Frame, FrameUp, Intrinsics};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// The color camera.
pub const CAMERA: Intrinsics =
    Intrinsics { width: 160, height: 120, fx: 130.0, fy: 130.0, cx: 79.5, cy: 59.5 };
/// Frames of the walk.
pub const FRAMES: usize = 40;

/// Corners of the boxes, metres; the last is the room, which is seen from inside.
const BOXES: [([f64; 3], [f64; 3]); 8] = [
    ([-1.9, 0.3, 1.2], [-1.2, 1.5, 1.8]),
    ([-0.6, 0.7, 1.7], [0.2, 1.5, 2.3]),
    ([0.8, 0.1, 1.4], [1.3, 1.5, 2.0]),
    ([1.8, 0.5, 0.0], [2.5, 1.5, 0.9]),
    ([-2.8, 0.6, -0.6], [-2.2, 1.5, 0.3]),
    ([1.4, -0.4, 2.6], [2.4, 0.2, 3.1]),
    ([-1.0, -0.9, 2.7], [-0.2, -0.2, 3.2]),
    ([-3.0, -1.5, -3.5], [3.0, 1.5, 3.5]),
];

/// Depth along the ray's z, and the box that is hit.
fn cast(origin: &Vector3<f64>, way: &Vector3<f64>) -> (f64, usize) {
    let hit = |(low, high): &([f64; 3], [f64; 3]), is_room: bool| {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) =
                ((low[axis] - origin[axis]) / way[axis], (high[axis] - origin[axis]) / way[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        let depth = if is_room { leave } else { enter };
        (enter < leave && depth > 0.0).then_some(depth)
    };
    let hits = BOXES
        .iter()
        .enumerate()
        .filter_map(|(at, corners)| hit(corners, at + 1 == BOXES.len()).map(|depth| (depth, at)));
    hits.min_by(|a, b| a.0.total_cmp(&b.0)).expect("the room surrounds the camera")
}

/// What a camera sees from a pose: RGB and depth in metres.
pub fn shoot(camera: &Intrinsics, world_from_camera: &Isometry3<f64>) -> (Vec<u8>, Vec<f32>) {
    let origin = world_from_camera.translation.vector;
    let (mut rgb, mut depths) = (Vec::new(), Vec::new());
    for at in 0..camera.width * camera.height {
        let (u, v) = (f64::from(at % camera.width), f64::from(at / camera.width));
        let ray = Vector3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let way = world_from_camera.rotation * ray;
        let (depth, body) = cast(&origin, &way);
        let point = origin + depth * way;
        // Each box has a brightness of its own, and the room dim stripes.
        let stripes = (point.x * 3.0).sin() + (point.y * 4.0 + point.z * 2.0).sin();
        let grey = if body + 1 == BOXES.len() { 120.0 } else { 30.0 + 30.0 * body as f64 };
        rgb.extend([(grey + 8.0 * stripes) as u8; 3]);
        depths.push(depth as f32);
    }
    (rgb, depths)
}

/// Where the camera is at a frame: it sways from side to side, comes nearer and looks around.
pub fn pose(frame: usize) -> Isometry3<f64> {
    let at = frame as f64;
    let position = Vector3::new(0.8 * (at * 0.2).sin(), 0.1 * (at * 0.3).cos(), -1.8 + 0.04 * at);
    let rotation =
        UnitQuaternion::from_euler_angles(0.1 * (at * 0.35).sin(), 0.4 * (at * 0.23).cos(), 0.0);
    Isometry3::from_parts(position.into(), rotation)
}

/// A frame of the walk, as it should be sent.
pub fn frame(at: usize) -> Frame {
    seen_from(at, &pose(at))
}

/// A frame from a pose, as it should be sent.
pub fn seen_from(at: usize, world_from_camera: &Isometry3<f64>) -> Frame {
    let (rgb, depth_metres) = shoot(&CAMERA, world_from_camera);
    Frame {
        sequence: at as u64,
        timestamp_nanos: at as u64,
        intrinsics: CAMERA,
        rgb: rgb.into(),
        depth_metres: depth_metres.into(),
        depth_lag_nanos: 0,
        world_from_camera: Some(*world_from_camera),
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    }
}
