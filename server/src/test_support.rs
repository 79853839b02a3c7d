//! Shared by the tests of gRPC, HTTP and recordings: a pipeline with small budgets, a camera, a frame.

use crate::Config;
use crate::pipeline::engine::Engine;
use crate::pipeline::frame::{Frame, FrameUp, Intrinsics};
use lexsplat_proto::v1;
use nalgebra::{Isometry3, Vector3};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// A small camera.
pub const CAMERA: Intrinsics =
    Intrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 };

/// `configs/tiny.toml`, overridden by the environment.
pub fn config() -> Config {
    let tiny = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/tiny.toml");
    Config::load(Some(&tiny)).unwrap()
}

/// An engine whose maps are the same every time: the clock is `per_frame`.
pub fn per_frame_engine() -> Engine {
    let pipeline = config().pipeline();
    let clock = crate::pipeline::mapper::Clock::PerFrame;
    let mapper = crate::pipeline::mapper::MapperConfig { clock, ..pipeline.mapper };
    Engine::start(crate::pipeline::engine::PipelineConfig { mapper, ..pipeline }).unwrap()
}

/// One pipeline for all tests: loading the networks is slow.
pub fn engine() -> Arc<Engine> {
    static ENGINE: OnceLock<Arc<Engine>> = OnceLock::new();
    let start = || {
        let pipeline = config().pipeline();
        // Each test creates maps of its own.
        let mapper = crate::pipeline::mapper::MapperConfig { max_maps: 64, ..pipeline.mapper };
        Arc::new(
            Engine::start(crate::pipeline::engine::PipelineConfig { mapper, ..pipeline }).unwrap(),
        )
    };
    ENGINE.get_or_init(start).clone()
}

/// A frame of one pixel without a pose.
pub fn pixel_frame() -> Frame {
    Frame {
        sequence: 0,
        timestamp_nanos: 0,
        intrinsics: Intrinsics { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
        rgb: [0; 3].into(),
        depth_metres: [1.0].into(),
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    }
}

/// The message that opens a map for [`CAMERA`], with given poses.
pub fn open_message(map: &str) -> v1::OpenMap {
    v1::OpenMap {
        map: map.into(),
        intrinsics: Some(v1::Intrinsics {
            width: CAMERA.width,
            height: CAMERA.height,
            fx: CAMERA.fx,
            fy: CAMERA.fy,
            cx: CAMERA.cx,
            cy: CAMERA.cy,
        }),
        depth_unit_metres: 0.001,
        pose_source: v1::PoseSource::Given.into(),
        ..v1::OpenMap::default()
    }
}

/// A grey wall, 2 m away.
pub fn frame(sequence: u64) -> v1::Frame {
    let pixels = (CAMERA.width * CAMERA.height) as usize;
    v1::Frame {
        sequence,
        timestamp_nanos: sequence * 100_000_000,
        color_format: v1::ColorFormat::Rgb8.into(),
        color: vec![120; pixels * 3].into(),
        depth_format: v1::DepthFormat::U16.into(),
        depth: 2000_u16.to_le_bytes().repeat(pixels).into(),
        world_from_camera: Some(v1::Pose {
            rotation: Some(v1::Quaternion { w: 1.0, ..Default::default() }),
            translation_metres: Some(v1::Vector3::default()),
        }),
        pose_covariance: Vec::new(),
        ..Default::default()
    }
}

/// The camera in the ray-cast room.
pub const ROOM_CAMERA: Intrinsics =
    Intrinsics { width: 160, height: 120, fx: 130.0, fy: 130.0, cx: 79.5, cy: 59.5 };

/// What [`ROOM_CAMERA`] sees of the ray-cast room.
pub fn ray_cast_room(world_from_camera: &Isometry3<f64>) -> Vec<(Vector3<f64>, f64)> {
    ray_cast(&ROOM_CAMERA, world_from_camera)
}

/// What a camera sees of a room of 6x3.2x7 metres with a ball in it, row by row: the place in the world that
/// each pixel shows, and its depth, both in metres.
pub fn ray_cast(
    camera: &Intrinsics,
    world_from_camera: &Isometry3<f64>,
) -> Vec<(Vector3<f64>, f64)> {
    let origin = world_from_camera.translation.vector;
    let (low, high) = (Vector3::new(-3.0, -1.6, -3.5), Vector3::new(3.0, 1.6, 3.5));
    let ball = Vector3::new(0.6, 0.5, 2.2) - origin;
    let seen = |at: u32| {
        let (u, v) = (f64::from(at % camera.width), f64::from(at / camera.width));
        let ray = Vector3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let way = world_from_camera.rotation * ray;
        let wall = |i: usize| {
            let side = if way[i] > 0.0 { high[i] } else { low[i] };
            (side - origin[i]) / way[i]
        };
        let (half, square) = (way.dot(&ball), way.norm_squared());
        let root = half * half - square * (ball.norm_squared() - 0.16);
        let ball = (root > 0.0).then(|| (half - root.sqrt()) / square).filter(|z| *z > 0.0);
        let z = (0..3).map(wall).chain(ball).fold(f64::INFINITY, f64::min);
        (origin + z * way, z)
    };
    (0..camera.width * camera.height).map(seen).collect()
}

/// A grey level of a surface with a warm tint, RGB.
pub fn tinted(grey: f64) -> [u8; 3] {
    [1.0, 0.9, 0.7].map(|tint| (grey * tint).clamp(0.0, 255.0) as u8)
}

/// Damages a file or a message: flips bits, puts extreme numbers in, cuts, repeats or inserts bytes.
pub fn mutate(random: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    for _ in 0..random.random_range(1..5) {
        let length = bytes.len();
        let at = random.random_range(0..=length);
        let some = random.random_range(0..=(length - at).min(64));
        match random.random_range(0..6) {
            0 if at < length => bytes[at] ^= 1 << random.random_range(0..8),
            1 => {
                let extremes = [0, 1, i64::MAX as u64, u64::MAX, u64::from(u32::MAX), 1 << 40];
                let number = extremes[random.random_range(0..extremes.len())].to_le_bytes();
                bytes[at..at + some.min(8)].copy_from_slice(&number[..some.min(8)]);
            }
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..at + some)),
            4 => {
                let repeated = bytes[at..at + some].to_vec();
                bytes.splice(at..at, repeated);
            }
            _ => {
                let noise: Vec<u8> = (0..some).map(|_| random.random()).collect();
                bytes.splice(at..at, noise);
            }
        }
    }
}

/// How many mutations a test tries: `MUTATIONS`, as `make fuzz` sets it, or so many.
pub fn mutations(few: u64) -> u64 {
    std::env::var("MUTATIONS").map_or(few, |many| many.parse().expect("a number"))
}
