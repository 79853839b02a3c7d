//! Kernels over flat arrays that know nothing of Gaussians.

pub mod gather;
pub mod reduce;
pub mod scan;
pub mod sort;
