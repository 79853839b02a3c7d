#![doc = include_str!("../README.md")]

mod adapter;
pub mod device;
pub mod map;
pub mod pass;
pub mod primitives;
pub mod shader;
pub mod track;
pub mod train;

pub use adapter::{AdapterReport, selftest};
pub use device::{Buffer, Gpu, GpuError, KernelTime, SOFTWARE_SUBGROUP, Tier};
pub use map::{
    Gaussians, Head, HeadKind, HostGaussians, HostHead, MAX_CHANNELS, Parameters, SavedGaussians,
};
pub use pass::{
    Camera, ColorImage, Contribution, Drawn, HeadGradient, LanguageImage, Renderer, Workload,
};
pub use shader::{Kernel, Recorder};
pub use track::align::{AlignSettings, Aligned, Aligner, Estimate, NormalSystem, Schedule};
pub use track::pyramid::{Pyramid, Pyramids};
pub use track::{align, pyramid};
pub use train::adam::{HeadRates, LearningRates, Youth};
pub use train::loss::{LossWeights, Losses};
pub use train::ties::Ties;
pub use train::{ColorTarget, Focus, LanguageTarget, StepReport, Trainer, TrainingView};
