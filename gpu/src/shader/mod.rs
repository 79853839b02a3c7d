//! WGSL kernels: composing their text, compiling it and dispatching it.

mod compose;
mod kernel;
pub mod layout;
mod layout_macros;
mod recorder;
mod shared;
mod tiling;

pub use compose::{Access, Constant, Shader};
pub use kernel::Kernel;
pub use recorder::Recorder;
pub use shared::{
    CONIC, COVERED, EXTENT, GEOMETRY, GRID, HITS, LANES_SUBGROUP, LANES_WORKGROUP, SCALES, TILE,
};
pub use tiling::Tiling;
