//! Feeds a fuzzer's bytes to the properties that `cargo test` holds on seeded bytes: one source,
//! tests/proof/wild.rs.
#![no_main]

use std::sync::{LazyLock, Mutex, PoisonError};

use lexsplat_gpu::{Gpu, Trainer};
use libfuzzer_sys::fuzz_target;

#[path = "../../tests/proof/wild.rs"]
mod wild;

/// One device and one trainer for all inputs, as a server has; the lists that one scene has grown
/// are there for the next.
static TRAINER: LazyLock<(Gpu, Mutex<Trainer>)> = LazyLock::new(|| {
    let gpu = Gpu::new(None).expect("fuzzing needs a vulkan adapter");
    let trainer = Trainer::new(&gpu, wild::CHANNELS).expect("compiles");
    (gpu, Mutex::new(trainer))
});

fuzz_target!(|bytes: &[u8]| {
    let (gpu, trainer) = &*TRAINER;
    let mut trainer = trainer.lock().unwrap_or_else(PoisonError::into_inner);
    wild::hold(gpu, &mut trainer, bytes);
});
