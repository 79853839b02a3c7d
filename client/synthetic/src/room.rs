//! A furnished room of a seed: its objects, a walk of the camera through it, and its views.

use crate::camera::{Camera, View};
use crate::layout::{self, Furnished};
use crate::mesh::Mesh;
use crate::path::Loop;
use crate::render::render;
use crate::scene::Scene;
use glam::Vec3;
use nalgebra::Isometry3;

/// An object in the room, or a part of the room itself such as a wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Value of its pixels in instance masks, from 1.
    pub id: u8,
    /// Unique name, such as `chair_2`.
    pub name: String,
    /// Class name, such as `chair`.
    pub class: &'static str,
    /// Smallest corner of its bounding box in the world, metres.
    pub aabb_min: [f64; 3],
    /// Largest corner, metres.
    pub aabb_max: [f64; 3],
}

/// Classes that make up the room itself.
pub const STRUCTURE: [&str; 3] = ["wall", "floor", "ceiling"];

/// A furnished room.
#[derive(Debug)]
pub struct Room {
    scene: Scene,
    instances: Vec<Instance>,
    walk: Loop,
}

impl Room {
    /// Furnishes a room. Light is baked when the first view is rendered.
    pub fn new(seed: u64) -> Self {
        let Furnished { builder, lights, walk } = layout::furnish(seed);
        let scene = Scene::new(builder.mesh, lights);
        let instances = instances(&scene.mesh, &builder.classes);
        Self { scene, instances, walk }
    }

    /// Every object; entry `i` has id `i + 1`.
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// `world_from_camera` of each frame of a hand-held walk of `frames` frames, metres.
    pub fn path(&self, frames: usize) -> Vec<Isometry3<f64>> {
        self.walk.walk(frames)
    }

    /// Renders the view of `camera` at the pose `world_from_camera`.
    pub fn render(&self, camera: &Camera, world_from_camera: &Isometry3<f64>) -> View {
        render(&self.scene, camera, world_from_camera)
    }
}

fn instances(mesh: &Mesh, classes: &[&'static str]) -> Vec<Instance> {
    let mut list: Vec<Instance> = Vec::with_capacity(classes.len());
    for (i, &class) in classes.iter().enumerate() {
        let id = i as u8 + 1;
        let number = 1 + list.iter().filter(|other| other.class == class).count();
        let (low, high) = mesh.bounds(id);
        let corner = |p: Vec3| [p.x, p.y, p.z].map(f64::from);
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
