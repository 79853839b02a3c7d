//! The bundle of networks (paper §4.1): a folder with `manifest.toml` and ONNX files.
//!
//! In: the folder. Out: [`VisionNetworks`] for the language thread and [`TextNetworks`] for the
//! query thread. Both are checked against the manifest: files by SHA-256, tensors by name, type and
//! shape, and each chain of networks by one run. The server knows no architecture, only the
//! manifest. No other folder names `ort`.

mod availability;
mod bundle;
mod error;
mod find;
mod manifest;
mod networks;
mod provider;
mod runtime;
mod tensor;

pub use availability::ProviderError;
pub use bundle::{Bundle, BundleError, BundleOptions};
pub use error::NetworkError;
pub use find::FindError;
pub use manifest::{ChannelOrder, Fit, GENERIC_SIZE, ImageSpec, ManifestError, RelevancySpec};
pub use networks::{TextNetworks, TextTower, VisionNetworks, VisionStages};
pub use provider::Provider;
pub use runtime::Network;
pub use tensor::Tensor;

#[cfg(test)]
mod tests;
