//! The splatting pass of one view: images from a map, and gradients of the images back to the map.

mod bands;
mod binning;
pub mod blend;
mod camera;
mod gradients;
mod head;
mod image;
pub mod order;
pub mod project;
mod projected;
mod render;
#[cfg(test)]
mod tests;
pub mod tiles;

pub use camera::Camera;
pub use gradients::HeadGradient;
pub use image::{ColorImage, Contribution, Drawn, LanguageImage, Workload};
pub use projected::Projected;
pub use render::Renderer;

pub(crate) use head::HeadPass;
pub(crate) use render::HeadCameras;
