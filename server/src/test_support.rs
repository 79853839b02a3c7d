//! Shared by the tests of gRPC, HTTP and recordings: a pipeline with small budgets, a camera, a frame.

use crate::Config;
use crate::pipeline::engine::Engine;
use crate::pipeline::frame::Intrinsics;
use lexsplat_proto::v1;
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
        label_texts: Vec::new(),
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
