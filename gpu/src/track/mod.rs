//! Tracking: RGB-D pyramids, and the alignment of one to another.

pub mod align;
pub mod pyramid;
