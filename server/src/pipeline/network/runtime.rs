//! ONNX Runtime, loaded at run time: a [`Network`] is one ONNX file with named inputs and outputs.
//!
//! In: the bytes of a checked file. Out: tensors. Tensors pass from one network to the next without
//! a copy. Types and shapes are checked when a file is loaded (where the graph declares them) and
//! at every run.

use super::provider::Provider;
use super::tensor::{Declared, Tensor};
use ort::session::builder::SessionBuilder;
use ort::session::{Session, SessionInputValue};
use ort::value::TensorElementType;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Mutex;

/// Why a network does not load or run.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// ONNX Runtime's own words.
    #[error("ONNX Runtime: {0}")]
    Runtime(String),
    /// A tensor is not as the manifest says.
    #[error("tensor {tensor:?}: expected {expected}, found {found}")]
    Tensor {
        /// The tensor.
        tensor: String,
        /// Type and shape, `?` where any will do.
        expected: String,
        /// What the graph has.
        found: String,
    },
    /// Words that cannot be split.
    #[error("the tokenizer failed: {reason}")]
    Tokenizer {
        /// Its words.
        reason: String,
    },
}

impl<R> From<ort::Error<R>> for NetworkError {
    fn from(error: ort::Error<R>) -> Self {
        Self::Runtime(error.message().to_owned())
    }
}

/// The process's one environment: ONNX Runtime takes no second one.
static ENVIRONMENT: Mutex<Option<ort::environment::Environment>> = Mutex::new(None);

/// ONNX Runtime, ready to load graphs.
#[derive(Clone)]
pub(super) struct Runtime(ort::environment::Environment);

impl Runtime {
    /// Loads the library, or takes the one that this process has loaded before.
    pub(super) fn open(library: &Path) -> Result<Self, NetworkError> {
        let mut environment =
            ENVIRONMENT.lock().expect("nobody panics while opening the environment");
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

    /// A session to be: with these providers first, one that cannot be had is an error.
    /// `threads` 0: one for each core.
    pub(super) fn builder(
        &self,
        providers: &[Provider],
        threads: usize,
    ) -> Result<SessionBuilder, NetworkError> {
        let dispatches: Vec<_> =
            providers.iter().filter_map(|provider| provider.dispatch()).collect();
        // Idle threads must not spin: the renderer wants the cores.
        Ok(Session::builder(&self.0)?
            .with_execution_providers(dispatches)?
            .with_intra_threads(threads)?
            .with_intra_op_spinning(false)?)
    }
}

/// One ONNX file with the inputs and outputs that are used of it, in the manifest's order.
pub struct Network {
    session: Session,
    inputs: Vec<(String, Declared)>,
    outputs: Vec<(String, Declared)>,
    /// In which precision the graph takes each input.
    kinds: Vec<Option<TensorElementType>>,
}

impl Network {
    /// Loads a graph and checks the tensors it declares.
    pub(super) fn load(
        builder: SessionBuilder,
        bytes: &[u8],
        inputs: Vec<(String, Declared)>,
        outputs: Vec<(String, Declared)>,
    ) -> Result<Self, NetworkError> {
        let mut builder = builder;
        let session = builder.commit_from_memory(bytes)?;
        for (wanted, outlets) in [(&inputs, session.inputs()), (&outputs, session.outputs())] {
            for (name, declared) in wanted {
                let outlet = outlets.iter().find(|outlet| outlet.name() == name);
                let outlet = outlet.ok_or_else(|| NetworkError::Tensor {
                    tensor: name.clone(),
                    expected: declared.to_string(),
                    found: format!(
                        "only {:?}",
                        outlets.iter().map(|outlet| outlet.name()).collect::<Vec<_>>()
                    ),
                })?;
                declared.check(name, outlet.dtype())?;
            }
        }
        let kind = |(name, _): &(String, Declared)| {
            let outlet = session.inputs().iter().find(|outlet| outlet.name() == name)?;
            outlet.dtype().tensor_type()
        };
        let kinds = inputs.iter().map(kind).collect();
        Ok(Self { session, inputs, outputs, kinds })
    }

    /// Names of the inputs, in order.
    pub fn input_names(&self) -> impl Iterator<Item = &str> {
        self.inputs.iter().map(|(name, _)| name.as_str())
    }

    /// A size that the graph fixes for one of its inputs; `None` if it takes any.
    pub fn declared_input_size(&self, input: usize, axis: usize) -> Option<usize> {
        let (name, _) = &self.inputs[input];
        let outlet = self.session.inputs().iter().find(|outlet| outlet.name() == name)?;
        usize::try_from(*outlet.dtype().tensor_shape()?.get(axis)?).ok()
    }

    /// Runs the graph; inputs and outputs in the manifest's order.
    ///
    /// # Errors
    /// [`NetworkError`] if an input or output has another type or shape than the manifest says, or
    /// if ONNX Runtime fails.
    pub fn run(&mut self, inputs: &[Tensor]) -> Result<Vec<Tensor>, NetworkError> {
        assert_eq!(inputs.len(), self.inputs.len(), "a tensor for each input");
        let mut converted = Vec::with_capacity(inputs.len());
        for (((name, declared), &kind), tensor) in self.inputs.iter().zip(&self.kinds).zip(inputs) {
            declared.check(name, tensor.value().dtype())?;
            converted.push(tensor.converted(kind));
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
            .map(|(name, declared)| {
                let value = found.remove(name).expect("the graph was checked to have it");
                declared.check(name, value.dtype())?;
                Ok(Tensor::from_value(value))
            })
            .collect()
    }
}
