//! A **synthetic** furnished room: made from a seed, rendered on the CPU, with exact depth,
//! instance masks and poses.
//!
//! [`Room::render`] gives views in memory, [`write()`] a folder in Replica layout and
//! [`SyntheticDataset`] a data set to stream. [`sensor`] makes a clean data set look like a real
//! camera's. World: metres, z up, origin on the floor in the
//! middle of the room. The same seed gives the same bytes.

mod bvh;
mod camera;
mod dataset;
mod dice;
mod encode;
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
mod room;
mod scene;
pub mod sensor;
mod shake;
mod shapes;
mod surface;
mod vector;
mod write;

#[cfg(test)]
mod tests;

pub use camera::{Camera, View};
pub use dataset::{SyntheticDataset, Walk};
pub use encode::{depth_png, jpeg, mask_png};
pub use room::{Instance, Room, STRUCTURE};
pub use write::{Plan, WriteError, write, write_dataset};
