//! Which of the configured execution providers work on this machine.
//!
//! In: the configured providers, preferred ones first. Out: those on which a network of one node
//! runs.

use super::error::NetworkError;
use super::provider::Provider;
use super::runtime::{Network, Runtime};
use super::tensor::{Tensor, TensorSpec};

/// Why the configured providers cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ProviderError {
    /// The list is empty.
    #[error("language.providers: expected at least one of cpu, cuda, tensorrt, webgpu, found none")]
    Empty,
    /// None of the providers works.
    #[error(
        "language.providers: {reasons}; point language.runtime to an ONNX Runtime that has it, or \
         add \"cpu\" at the end to go on without"
    )]
    Unusable {
        /// Each provider with ONNX Runtime's message.
        reasons: String,
    },
}

/// Those of `wanted` that work on this machine, in this order, without the CPU. If `wanted` has the
/// CPU, missing providers are only logged.
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

/// Runs a network of one node on the provider.
fn probe(runtime: &Runtime, provider: Provider) -> Result<(), String> {
    if !provider.is_built_in() {
        return Err("the loaded ONNX Runtime was built without it".into());
    }
    run_probe(runtime, provider).map_err(|error| error.to_string())
}

fn run_probe(runtime: &Runtime, provider: Provider) -> Result<(), NetworkError> {
    let spec = |name: &str| vec![(name.to_owned(), TensorSpec::floats([1]))];
    let builder = runtime.builder(&[provider], 1)?;
    let mut network = Network::load(builder, &PROBE, spec("x"), spec("y"))?;
    network.run(&[Tensor::floats(&[1], vec![-1.0])]).map(|_| ())
}

/// An ONNX model as protobuf fields: y = Relu(x), both of one float.
#[rustfmt::skip]
const PROBE: [u8; 59] = [
    0x08, 8, // ir_version
    0x42, 2, 0x10, 17, // opset_import: version 17 of the standard operators
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
        let library = find::runtime(None).expect("`make deps` has installed it");
        let runtime = Runtime::open(&library).expect("it opens");
        run_probe(&runtime, Provider::Cpu).expect("it runs");
        // Negative control: a provider that was not built in fails, even without `probe`'s check.
        let error = run_probe(&runtime, Provider::Cuda).expect_err("the library has no CUDA");
        assert!(error.to_string().contains("ONNX Runtime"), "{error}");
    }
}
