//! Shared by the tests of gRPC and HTTP: a pipeline with small budgets, and a camera.

use crate::Config;
use crate::pipeline::engine::Engine;
use crate::pipeline::frame::Intrinsics;
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
