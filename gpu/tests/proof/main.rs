//! Tests of this crate: kernels against oracles, gradients against differences, and properties that
//! hold for any map. All but `shaders` and `differences` need a Vulkan adapter and fail without
//! one.

mod align;
mod align_speed;
mod backward;
mod bands;
mod differences;
mod example;
mod focus;
mod forward;
mod fuzz;
mod golden;
mod map;
mod metamorphic;
mod normal_system;
mod optimiser;
mod oracle;
mod poison;
mod primitives;
mod pyramid;
mod room;
mod shaders;
mod support;
mod tiers;
mod ties;
mod training;
mod wild;
mod windows;
