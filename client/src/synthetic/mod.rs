//! A **synthetic** furnished room: seeded, procedural, rendered on the CPU, with exact depth,
//! instance masks and poses. In: a seed; out: views in memory ([`Room::render`]) or a folder in
//! Replica layout ([`write`]). World: metres, z up, origin on the floor in the middle of the room.
//! Same seed, same bytes. It makes pictures only: datasets and streaming are [`crate::dataset`]'s.

mod bvh;
mod dice;
mod furniture;
mod layout;
mod light;
mod material;
mod mesh;
mod noise;
mod path;
mod places;
mod prints;
mod render;
mod shapes;
mod vector;
pub mod write;

#[cfg(test)]
mod tests;

use bvh::Bvh;
use light::{Baked, Light};
use mesh::Mesh;
use nalgebra::Isometry3;
use std::sync::OnceLock;
use vector::V3;

/// A pinhole camera; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Focal length, pixels.
    pub fx: f64,
    /// Focal length, pixels.
    pub fy: f64,
    /// Principal point, pixels.
    pub cx: f64,
    /// Principal point, pixels.
    pub cy: f64,
}

impl Camera {
    /// A centred camera with square pixels and a horizontal field of view of 70 degrees.
    pub fn new(width: u32, height: u32) -> Self {
        let focal = f64::from(width) / 2.0 / 35.0_f64.to_radians().tan();
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: (f64::from(width) - 1.0) / 2.0,
            cy: (f64::from(height) - 1.0) / 2.0,
        }
    }
}

/// What a camera sees.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// sRGB, 3 bytes per pixel, row by row.
    pub rgb: Vec<u8>,
    /// Camera z at pixel centres, metres; 0 where nothing is hit.
    pub depth: Vec<f32>,
    /// Instance ids, 0 where nothing is hit.
    pub instances: Vec<u8>,
}

/// One thing in the room.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Value in the masks, from 1.
    pub id: u8,
    /// Unique name, such as `chair_2`.
    pub name: String,
    /// Class name, such as `chair`.
    pub class: &'static str,
    /// Smallest corner of its bounding box in the world, metres.
    pub aabb_min: [f64; 3],
    /// Largest corner.
    pub aabb_max: [f64; 3],
}

/// Classes that make up the room itself.
pub const STRUCTURE: [&str; 3] = ["wall", "floor", "ceiling"];

/// A furnished room.
#[derive(Debug)]
pub struct Room {
    mesh: Mesh,
    bvh: Bvh,
    lights: Vec<Light>,
    /// Centre and power of every light, for highlights.
    highlights: Vec<(V3, V3)>,
    instances: Vec<Instance>,
    walk: path::Loop,
    baked: OnceLock<Baked>,
}

impl Room {
    /// Furnishes a room. Light is baked when the first view is rendered.
    pub fn new(seed: u64) -> Self {
        let layout::Furnished { builder, lights, walk } = layout::furnish(seed);
        let mut mesh = builder.mesh;
        let bvh = Bvh::build(&mut mesh);
        let instances = instances(&mesh, &builder.classes);
        let highlights = lights.iter().map(|l| (l.centre(), l.power)).collect();
        Self { mesh, bvh, lights, highlights, instances, walk, baked: OnceLock::new() }
    }

    /// Everything in the room; entry `i` has id `i + 1`.
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// `world_from_camera` of a hand-held walk of that many frames.
    pub fn path(&self, frames: usize) -> Vec<Isometry3<f64>> {
        self.walk.walk(frames)
    }

    /// Renders the view of `camera` at `pose` (`world_from_camera`).
    pub fn render(&self, camera: &Camera, pose: &Isometry3<f64>) -> View {
        render::render(self, camera, pose)
    }

    fn baked(&self) -> &Baked {
        self.baked.get_or_init(|| Baked::bake(&self.mesh, &self.bvh, &self.lights))
    }
}

fn instances(mesh: &Mesh, classes: &[&'static str]) -> Vec<Instance> {
    let mut list: Vec<Instance> = Vec::with_capacity(classes.len());
    for (i, &class) in classes.iter().enumerate() {
        let id = i as u8 + 1;
        let number = 1 + list.iter().filter(|other| other.class == class).count();
        let (low, high) = mesh.bounds(id);
        let corner = |p: V3| [p.x, p.y, p.z].map(f64::from);
        list.push(Instance {
            id,
            name: format!("{class}_{number}").replace(' ', "_"),
            class,
            aabb_min: corner(low),
            aabb_max: corner(high),
        });
    }
    list
}
