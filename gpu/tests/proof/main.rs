//! Everything that is claimed of this package: kernels against oracles, gradients against
//! differences, and what must hold for any map. All but `shaders` and `oracle` need a Vulkan
//! adapter and fail without one.

mod align;
mod align_speed;
mod backward;
mod differences;
mod example;
mod forward;
mod fuzz;
mod golden;
mod map;
mod metamorphic;
mod optimiser;
mod oracle;
mod poison;
mod primitives;
mod pyramid;
mod room;
mod shaders;
mod support;
mod tiers;
mod training;
mod wild;
