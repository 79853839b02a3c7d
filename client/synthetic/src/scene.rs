//! Everything that a ray can meet: surfaces, their hierarchy and their light. Views are rendered of
//! it.

use crate::bvh::Bvh;
use crate::light::{Baked, Light};
use crate::mesh::Mesh;
use glam::Vec3;
use std::sync::OnceLock;

/// A light as the source of highlights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Highlight {
    pub centre: Vec3,
    /// Irradiance at one metre, linear RGB.
    pub power: Vec3,
}

/// Surfaces with light.
#[derive(Debug)]
pub(crate) struct Scene {
    pub mesh: Mesh,
    pub bvh: Bvh,
    pub highlights: Vec<Highlight>,
    lights: Vec<Light>,
    baked: OnceLock<Baked>,
}

impl Scene {
    /// Builds the hierarchy; light is baked when it is first needed.
    pub fn new(mut mesh: Mesh, lights: Vec<Light>) -> Self {
        let bvh = Bvh::build(&mut mesh);
        let highlight = |light: &Light| Highlight { centre: light.centre(), power: light.power };
        let highlights = lights.iter().map(highlight).collect();
        Self { mesh, bvh, highlights, lights, baked: OnceLock::new() }
    }

    /// Irradiance on every surface.
    pub fn baked(&self) -> &Baked {
        self.baked.get_or_init(|| Baked::bake(&self.mesh, &self.bvh, &self.lights))
    }
}
