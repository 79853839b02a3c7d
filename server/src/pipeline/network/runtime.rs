//! ONNX Runtime, loaded at run time, and [`Network`]: one ONNX graph with named inputs and outputs.
//!
//! In: the bytes of a checked file. Out: tensors. Tensors pass from one network to the next without
//! a copy. Types and shapes are checked when a graph is loaded, as far as it declares them, and at
//! every run.

use super::error::NetworkError;
use super::provider::Provider;
use super::tensor::{Tensor, TensorSpec};
use ort::session::builder::SessionBuilder;
use ort::session::{Session, SessionInputValue};
use ort::value::TensorElementType;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Mutex;

/// The only environment of this process: ONNX Runtime does not permit a second one.
static ENVIRONMENT: Mutex<Option<ort::environment::Environment>> = Mutex::new(None);

/// ONNX Runtime, ready to load graphs.
#[derive(Clone)]
pub(super) struct Runtime(ort::environment::Environment);

impl Runtime {
    /// Loads the library, or returns the one that this process has already loaded.
    pub(super) fn open(library: &Path) -> Result<Self, NetworkError> {
        let mut environment =
            ENVIRONMENT.lock().expect("no thread panics while it opens the environment");
        if let Some(environment) = &*environment {
            return Ok(Self(environment.clone()));
        }
        let absolute =
            library.canonicalize().map_err(|error| NetworkError::Runtime(error.to_string()))?;
        let opened = ort::init_from(absolute)
            .map_err(|error| NetworkError::Runtime(error.to_string()))?
            .with_name("lexsplat")
            .with_telemetry(false)
            .build()?;
        Ok(Self(environment.insert(opened).clone()))
    }

    /// A builder for sessions that prefer these providers, in order. A provider that is not
    /// available is an error. `threads` 0: one for each core.
    pub(super) fn builder(
        &self,
        providers: &[Provider],
        threads: usize,
    ) -> Result<SessionBuilder, NetworkError> {
        let dispatches: Vec<_> =
            providers.iter().filter_map(|provider| provider.dispatch()).collect();
        // Idle threads must not spin: the mapper needs the cores.
        Ok(Session::builder(&self.0)?
            .with_execution_providers(dispatches)?
            .with_intra_threads(threads)?
            .with_intra_op_spinning(false)?)
    }
}

/// One ONNX graph with those of its inputs and outputs that are used, in the manifest's order.
pub struct Network {
    session: Session,
    inputs: Vec<(String, TensorSpec)>,
    outputs: Vec<(String, TensorSpec)>,
    /// Element type of each input in the graph.
    input_types: Vec<Option<TensorElementType>>,
}

impl Network {
    /// Loads a graph and checks the tensors that it declares.
    pub(super) fn load(
        builder: SessionBuilder,
        bytes: &[u8],
        inputs: Vec<(String, TensorSpec)>,
        outputs: Vec<(String, TensorSpec)>,
    ) -> Result<Self, NetworkError> {
        let mut builder = builder;
        let session = builder.commit_from_memory(bytes)?;
        for (wanted, outlets) in [(&inputs, session.inputs()), (&outputs, session.outputs())] {
            for (name, spec) in wanted {
                let outlet = outlets.iter().find(|outlet| outlet.name() == name);
                let outlet = outlet.ok_or_else(|| NetworkError::Tensor {
                    tensor: name.clone(),
                    expected: spec.to_string(),
                    found: format!(
                        "only {:?}",
                        outlets.iter().map(|outlet| outlet.name()).collect::<Vec<_>>()
                    ),
                })?;
                spec.check(name, outlet.dtype())?;
            }
        }
        let input_type = |(name, _): &(String, TensorSpec)| {
            let outlet = session.inputs().iter().find(|outlet| outlet.name() == name)?;
            outlet.dtype().tensor_type()
        };
        let input_types = inputs.iter().map(input_type).collect();
        Ok(Self { session, inputs, outputs, input_types })
    }

    /// Names of the inputs, in the manifest's order.
    pub(super) fn input_names(&self) -> impl Iterator<Item = &str> {
        self.inputs.iter().map(|(name, _)| name.as_str())
    }

    /// Size of an axis of an input, if the graph fixes it.
    pub(super) fn declared_input_size(&self, input: usize, axis: usize) -> Option<usize> {
        let (name, _) = &self.inputs[input];
        let outlet = self.session.inputs().iter().find(|outlet| outlet.name() == name)?;
        usize::try_from(*outlet.dtype().tensor_shape()?.get(axis)?).ok()
    }

    /// Runs the graph. Inputs and outputs are in the manifest's order.
    ///
    /// # Errors
    /// [`NetworkError`] if a tensor has another type or shape than the manifest says, or if ONNX
    /// Runtime fails.
    ///
    /// # Panics
    /// If the number of inputs is not the manifest's.
    pub fn run(&mut self, inputs: &[Tensor]) -> Result<Vec<Tensor>, NetworkError> {
        assert_eq!(inputs.len(), self.inputs.len(), "one tensor for each input");
        let mut converted = Vec::with_capacity(inputs.len());
        for (((name, spec), &input_type), tensor) in
            self.inputs.iter().zip(&self.input_types).zip(inputs)
        {
            spec.check(name, tensor.value().dtype())?;
            converted.push(tensor.converted(input_type));
        }
        let fed: Vec<(Cow<'_, str>, SessionInputValue<'_>)> = self
            .inputs
            .iter()
            .zip(converted.iter().zip(inputs))
            .map(|((name, _), (converted, tensor))| {
                let value = converted.as_ref().unwrap_or(tensor).value();
                (Cow::from(name.as_str()), value.into())
            })
            .collect();
        let mut found = self.session.run(fed)?;
        self.outputs
            .iter()
            .map(|(name, spec)| {
                let value =
                    found.remove(name).expect("the output was checked when the graph was loaded");
                spec.check(name, value.dtype())?;
                Ok(Tensor::from_value(value))
            })
            .collect()
    }
}
