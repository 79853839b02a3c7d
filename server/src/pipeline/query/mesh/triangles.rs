//! The mesh.

use nalgebra::{Point3, Vector3};

/// Triangles with colors and language.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Metres, in the map's world.
    pub positions: Vec<Point3<f32>>,
    /// Unit length, towards free space.
    pub normals: Vec<Vector3<f32>>,
    /// Red, green, blue, 0..1.
    pub colors: Vec<[f32; 3]>,
    /// Mean codes of the online stage, `[vertices * code_size]`; zeros where no view has language.
    pub codes: Vec<f32>,
    /// Channels of a code.
    pub code_size: usize,
    /// Relevancies to a query, `[vertices]`; empty without a query.
    pub relevancies: Vec<f32>,
    /// Vertex indices of the triangles, counter-clockwise as seen from outside.
    pub faces: Vec<[u32; 3]>,
}
