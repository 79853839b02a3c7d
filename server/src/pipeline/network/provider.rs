//! ONNX Runtime's execution providers: on what networks run.
//!
//! In: the configured ones, best first. Out: those that work on this machine, which a network of one
//! node is run on to know. ONNX Runtime gives each node to the first of them that can take it, and
//! what none takes to the CPU. A provider is part of the loaded library or beside it: the library
//! that `make deps` gets has the CPU alone.

use super::runtime::{NetworkError, Runtime};
use super::tensor::{Declared, Tensor};
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use serde::{Deserialize, Serialize};

/// On what networks run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// Everywhere; last in a list, it says that the others may be missing.
    Cpu,
    /// NVIDIA, through CUDA and cuDNN.
    Cuda,
    /// NVIDIA, compiled for the device when a network is loaded, which takes minutes.
    TensorRt,
    /// Any GPU with Vulkan.
    WebGpu,
}

/// A configured list that cannot be followed.
#[derive(Debug, thiserror::Error)]
pub enum ProviderError {
    /// An empty list.
    #[error("language.providers: expected at least one of cpu, cuda, tensorrt, webgpu, found none")]
    Empty,
    /// Nothing in it works here.
    #[error(
        "language.providers: {reasons}; point language.runtime to an ONNX Runtime that has it, or \
         add \"cpu\" at the end to go on without"
    )]
    Unusable {
        /// Each provider with what ONNX Runtime says of it.
        reasons: String,
    },
}

impl Provider {
    /// For ONNX Runtime; `None` for the CPU, which is always there.
    pub(super) fn dispatch(self) -> Option<ExecutionProviderDispatch> {
        let dispatch = match self {
            Self::Cpu => return None,
            Self::Cuda => ep::CUDA::default().build(),
            Self::TensorRt => ep::TensorRT::default().build(),
            Self::WebGpu => ep::WebGPU::default().build(),
        };
        Some(dispatch.error_on_failure())
    }

    /// As it is written in the settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::WebGpu => "webgpu",
        }
    }

    /// Whether the loaded library was built with it.
    fn is_built_in(self) -> bool {
        let found = match self {
            Self::Cpu => Ok(true),
            Self::Cuda => ep::CUDA::is_available(),
            Self::TensorRt => ep::TensorRT::is_available(),
            Self::WebGpu => ep::WebGPU::is_available(),
        };
        found.unwrap_or(false)
    }
}

/// Those of `wanted` that work, in this order, without the CPU. What is missing is logged if the list
/// allows for it.
pub(super) fn choose(
    runtime: &Runtime,
    wanted: &[Provider],
) -> Result<Vec<Provider>, ProviderError> {
    if wanted.is_empty() {
        return Err(ProviderError::Empty);
    }
    let (mut chosen, mut missing) = (Vec::new(), Vec::new());
    for &provider in wanted.iter().filter(|&&provider| provider != Provider::Cpu) {
        match probe(runtime, provider) {
            Ok(()) => chosen.push(provider),
            Err(reason) => missing.push(format!("{}: {reason}", provider.name())),
        }
    }
    let reasons = missing.join("; ");
    if chosen.is_empty() && !wanted.contains(&Provider::Cpu) {
        return Err(ProviderError::Unusable { reasons });
    }
    let runs_on: Vec<&str> = chosen.iter().map(|provider| provider.name()).chain(["cpu"]).collect();
    if reasons.is_empty() {
        tracing::info!(providers = ?runs_on, "execution providers");
    } else {
        tracing::warn!(missing = reasons, providers = ?runs_on, "execution providers: some are missing");
    }
    Ok(chosen)
}

/// Runs a network of one node on it.
fn probe(runtime: &Runtime, provider: Provider) -> Result<(), String> {
    if !provider.is_built_in() {
        return Err("the loaded ONNX Runtime was built without it".into());
    }
    run_probe(runtime, provider).map_err(|error| error.to_string())
}

fn run_probe(runtime: &Runtime, provider: Provider) -> Result<(), NetworkError> {
    let declared = |name: &str| vec![(name.to_owned(), Declared::floats([1]))];
    let builder = runtime.builder(&[provider], 1)?;
    let mut network = super::Network::load(builder, &PROBE, declared("x"), declared("y"))?;
    network.run(&[Tensor::floats(&[1], vec![-1.0])]).map(|_| ())
}

/// An ONNX model, field by field: y = Relu(x), both of one float.
#[rustfmt::skip]
const PROBE: [u8; 59] = [
    0x08, 8, // ir_version
    0x42, 2, 0x10, 17, // opset_import: version 17 of the standard's
    0x3a, 51, // graph, with a node, a name, an input and an output
    0x0a, 12, 0x0a, 1, b'x', 0x12, 1, b'y', 0x22, 4, b'R', b'e', b'l', b'u',
    0x12, 1, b'p',
    0x5a, 15, 0x0a, 1, b'x', 0x12, 10, 0x0a, 8, 0x08, 1, 0x12, 4, 0x0a, 2, 0x08, 1,
    0x62, 15, 0x0a, 1, b'y', 0x12, 10, 0x0a, 8, 0x08, 1, 0x12, 4, 0x0a, 2, 0x08, 1,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::network::find;

    #[test]
    fn the_probe_is_a_network() {
        let library = find::runtime(None).expect("`make deps` got it");
        let runtime = Runtime::open(&library).expect("it opens");
        run_probe(&runtime, Provider::Cpu).expect("it runs");
        // Negative control: what was not built in does not run, whatever `probe` asks first.
        let error = run_probe(&runtime, Provider::Cuda).expect_err("the library has no CUDA");
        assert!(error.to_string().contains("ONNX Runtime"), "{error}");
    }
}
