#![doc = include_str!("../README.md")]

pub mod adam;
pub mod blend;
pub mod buffer;
mod camera;
mod device;
mod error;
pub mod gather;
mod gaussians;
mod gradients;
pub mod kernel;
pub mod layout;
pub mod loss;
pub mod oracle;
mod pass;
pub mod project;
pub mod reduce;
mod render;
pub mod scan;
pub mod shader;
pub mod sort;
mod target;
pub mod tiles;

pub use adam::{HeadRates, LearningRates};
pub use camera::Camera;
pub use device::{AdapterReport, Gpu, SOFTWARE_SUBGROUP, Tier};
pub use error::GpuError;
pub use gaussians::{Gaussians, Head, HostGaussians, HostHead, MAX_CHANNELS, Parameters};
pub use gradients::HeadGradient;
pub use loss::{LossWeights, Losses};
pub use render::{ColourImage, LanguageImage, Renderer, TrainingView};
pub use target::{ColourTarget, LanguageTarget};
