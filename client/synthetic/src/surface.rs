//! A point on a surface, in the coordinates that textures depend on.

use glam::Vec3;

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfacePoint {
    /// Surface coordinates, 0..1.
    pub uv: [f32; 2],
    /// Surface coordinates in metres.
    pub metres: [f32; 2],
    /// Position in the object's frame, metres.
    pub local: Vec3,
}
