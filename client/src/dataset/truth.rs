//! Ground truth about the objects of a scene: instances, and which pixels show them.

use super::error::DatasetError;
use super::text::whole_number;

/// An object in a scene, or a part of the room itself such as a wall.
#[derive(Clone, Debug, PartialEq, serde::Deserialize)]
pub struct Instance {
    /// Value of its pixels in the masks, from 1.
    #[serde(deserialize_with = "whole_number")]
    pub id: u16,
    /// Unique name, such as `chair_2`.
    pub name: String,
    /// Class name, such as `chair`.
    pub class: String,
    /// Smallest corner of its bounding box in the world, metres.
    pub aabb_min: [f64; 3],
    /// Largest corner, metres.
    pub aabb_max: [f64; 3],
}

/// The instance that each pixel of a frame shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// [`Instance::id`] per pixel, row by row; 0 is none.
    pub ids: Vec<u16>,
}

/// Ground truth about the objects of a scene.
pub trait Truth: Send + Sync {
    /// All instances of the scene.
    fn instances(&self) -> &[Instance];

    /// The instance mask of frame `index` of the data set.
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    fn mask(&self, index: usize) -> Result<Mask, DatasetError>;

    /// The classes of the objects, each once, without those of the room itself (walls, floor, ...).
    fn classes(&self) -> Vec<String> {
        let mut classes: Vec<String> = Vec::new();
        for Instance { class, .. } in self.instances() {
            if !STRUCTURE.contains(&class.as_str()) && !classes.contains(class) {
                classes.push(class.clone());
            }
        }
        classes
    }
}

/// Classes of the room itself.
const STRUCTURE: [&str; 4] = ["wall", "floor", "ceiling", "room"];
