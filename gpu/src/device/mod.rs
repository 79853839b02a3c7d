//! The bottom of the crate: an opened device, its buffers and its errors.

mod buffer;
mod error;
mod gpu;
mod profile;
mod tier;

pub use buffer::{Buffer, largest_binding};
pub use error::{GpuError, expect_len};
pub use gpu::Gpu;
pub use profile::KernelTime;
pub use tier::{SOFTWARE_SUBGROUP, Tier};

pub(crate) use profile::Stamps;
pub(crate) use tier::Facts;
