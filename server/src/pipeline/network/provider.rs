//! ONNX Runtime's execution providers: the hardware that networks run on.
//!
//! ONNX Runtime assigns each node of a graph to the first provider that supports it, and to the CPU
//! if none does. Providers are compiled into the loaded library or lie beside it; the library that
//! `make deps` installs has the CPU only.

use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use serde::{Deserialize, Serialize};

/// Execution provider.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// Always available. In a list with `cpu`, the others may be missing.
    Cpu,
    /// NVIDIA GPUs, through CUDA and cuDNN.
    Cuda,
    /// NVIDIA GPUs; networks are compiled for the device when they are loaded, which takes minutes.
    TensorRt,
    /// Any GPU with Vulkan.
    WebGpu,
}

impl Provider {
    /// ONNX Runtime's description of the provider; `None` for the CPU, which needs none.
    pub(super) fn dispatch(self) -> Option<ExecutionProviderDispatch> {
        let dispatch = match self {
            Self::Cpu => return None,
            Self::Cuda => ep::CUDA::default().build(),
            Self::TensorRt => ep::TensorRT::default().build(),
            Self::WebGpu => ep::WebGPU::default().build(),
        };
        Some(dispatch.error_on_failure())
    }

    /// Name in the settings.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::WebGpu => "webgpu",
        }
    }

    /// Whether the loaded library was built with the provider.
    pub(super) fn is_built_in(self) -> bool {
        let found = match self {
            Self::Cpu => Ok(true),
            Self::Cuda => ep::CUDA::is_available(),
            Self::TensorRt => ep::TensorRT::is_available(),
            Self::WebGpu => ep::WebGPU::is_available(),
        };
        found.unwrap_or(false)
    }
}
