//! A map as a triangle mesh with colors and language (the paper's 3D protocol, §5): views of the
//! keyframes are rendered and fused into a TSDF, and marching cubes extracts the surface.
//!
//! In: a snapshot. Out: a [`Mesh`] in the map's world, metres. Depth and color are fused in the
//! volume. Codes are averaged at the finished vertices over the views that see them: the result is
//! the same and needs a fifth of the memory. Each mesh is built on a thread and a renderer of its
//! own, so that neither mappers nor queries wait for it.

mod build;
mod cases;
mod depth_view;
mod surface;
mod triangles;
mod tsdf;
mod vertex_codes;

pub(crate) use build::mesh;
pub use triangles::Mesh;

#[cfg(test)]
mod tests;
