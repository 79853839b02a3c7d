//! WGSL functions that several kernels use.

/// Shared WGSL: the index of a thread in a grid that was split over two axes.
pub const GRID: &str = include_str!("shared/grid.wgsl");
/// Shared WGSL: pixels of a lane, and one Gaussian at four pixels.
pub const TILE: &str = include_str!("shared/tile.wgsl");
/// Shared WGSL: loading and publishing a batch of hits.
pub const HITS: &str = include_str!("shared/hits.wgsl");
/// Shared WGSL: exchange between lanes where a tile is one subgroup.
pub const LANES_SUBGROUP: &str = include_str!("shared/lanes_subgroup.wgsl");
/// Shared WGSL: exchange between lanes through workgroup memory.
pub const LANES_WORKGROUP: &str = include_str!("shared/lanes_workgroup.wgsl");
/// Shared WGSL: the conic of a splat.
pub const CONIC: &str = include_str!("shared/conic.wgsl");
/// Shared WGSL: the tiles that a splat overlaps; needs [`CONIC`].
pub const EXTENT: &str = include_str!("shared/extent.wgsl");
/// Shared WGSL: the tiles that a splat is drawn on; needs [`EXTENT`].
pub const COVERED: &str = include_str!("shared/covered.wgsl");
/// Shared WGSL: log scales to scales.
pub const SCALES: &str = include_str!("shared/scales.wgsl");
/// Shared WGSL: quaternion to matrix, and covariance in the image.
pub const GEOMETRY: &str = include_str!("shared/geometry.wgsl");
