//! The map on the device, and what rearranges it.

mod arrays;
pub mod densify;
mod gaussians;
mod host;
pub mod morton;
pub(crate) mod rows;
mod statistics;
mod surgery;
#[cfg(test)]
mod tests;
mod tools;

pub use arrays::{Arrays, Head, HeadKind, Parameters};
pub use gaussians::{Gaussians, MAX_CHANNELS};
pub use host::{HostGaussians, HostHead};
pub use statistics::Statistics;

pub(crate) use arrays::MapSlice;
