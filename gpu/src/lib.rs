#![doc = include_str!("../README.md")]

pub mod adam;
pub mod align;
pub mod blend;
pub mod buffer;
mod camera;
pub mod densify;
mod device;
mod error;
pub mod gather;
mod gaussians;
mod gradients;
pub mod kernel;
pub mod layout;
pub mod loss;
pub mod morton;
pub mod oracle;
pub mod order;
mod pass;
mod profile;
pub mod project;
pub mod pyramid;
pub mod reduce;
mod render;
pub mod scan;
pub mod shader;
pub mod sort;
mod step;
pub mod tally;
mod target;
pub mod ties;
pub mod tiles;
pub mod tiling;

pub use adam::{HeadRates, LearningRates};
pub use align::{AlignSettings, Aligned, Aligner, Estimate, NormalSystem, Schedule};
pub use camera::Camera;
pub use densify::{DensifyCounts, DensifyRules};
pub use device::{AdapterReport, Gpu, SOFTWARE_SUBGROUP, Tier};
pub use error::GpuError;
pub use gaussians::{
    Gaussians, Head, HostGaussians, HostHead, MAX_CHANNELS, Parameters, Statistics,
};
pub use gradients::HeadGradient;
pub use loss::{LossWeights, Losses};
pub use profile::KernelTime;
pub use pyramid::{Pyramid, Pyramids};
pub use render::{ColorImage, Contribution, Drawn, LanguageImage, Renderer, Workload};
pub use step::{StepReport, TrainingView};
pub use target::{ColorTarget, LanguageTarget};
pub use ties::Ties;
