//! The map on the device, and what rearranges it.

mod arrays;
mod gaussians;
mod host;
pub mod morton;
mod motion;
pub mod prune;
mod rearrange;
pub(crate) mod rows;
mod saved;
#[cfg(test)]
mod tests;
mod tools;

pub use arrays::{Arrays, Head, HeadKind, Parameters};
pub use gaussians::{Gaussians, MAX_CHANNELS};
pub use host::{HostGaussians, HostHead};
pub use saved::SavedGaussians;

pub(crate) use arrays::MapSlice;
