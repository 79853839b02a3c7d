//! Feeds a fuzzer's bytes to the properties that `cargo test` holds on seeded bytes: one source,
//! tests/proof/wild.rs.
#![no_main]

use std::sync::{LazyLock, Mutex, PoisonError};

use lexsplat_gpu::{Gpu, Renderer};
use libfuzzer_sys::fuzz_target;

#[path = "../../tests/proof/wild.rs"]
mod wild;

/// One device and one renderer for all inputs, as a server has; the lists that one scene has grown
/// are there for the next.
static RENDERER: LazyLock<(Gpu, Mutex<Renderer>)> = LazyLock::new(|| {
    let gpu = Gpu::new(None).expect("fuzzing needs a vulkan adapter");
    let renderer = Renderer::new(&gpu, wild::CHANNELS).expect("compiles");
    (gpu, Mutex::new(renderer))
});

fuzz_target!(|bytes: &[u8]| {
    let (gpu, renderer) = &*RENDERER;
    let mut renderer = renderer.lock().unwrap_or_else(PoisonError::into_inner);
    wild::hold(gpu, &mut renderer, bytes);
});
