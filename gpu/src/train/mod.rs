//! Training: losses, the optimiser and the steps that they make.

pub mod adam;
pub mod focus;
mod kernels;
pub mod loss;
mod step;
mod target;
mod targets_in_use;
mod texels;
pub mod ties;
mod trainer;

pub use focus::Focus;
pub use step::{StepReport, TrainingView};
pub use target::{ColorTarget, LanguageTarget};
pub use trainer::Trainer;
