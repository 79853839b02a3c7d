//! Limits of requests.

use std::ops::RangeInclusive;

/// The longest text, bytes.
pub(crate) const MAX_TEXT_BYTES: usize = 1024;
/// The most negatives in one request.
pub(crate) const MAX_NEGATIVES: usize = 32;
/// The most texts in one segmentation.
pub(crate) const MAX_TEXTS: usize = 32;
/// The longest side of a view that is answered or rendered, pixels.
pub(crate) const MAX_VIEW_SIDE: u32 = 4096;
/// Permitted sides of a mesh's voxels, metres.
pub(crate) const VOXEL_METRES: RangeInclusive<f32> = 0.002..=1.0;
/// Default side of a mesh's voxels, metres: the one of the paper's code (the text says 20 cm).
pub(crate) const DEFAULT_VOXEL_METRES: f32 = 0.02;
