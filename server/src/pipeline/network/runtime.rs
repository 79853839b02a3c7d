//! ONNX Runtime, loaded at run time: a [`Network`] is one ONNX file with named inputs and outputs.
//!
//! In: the bytes of a checked file. Out: tensors. Tensors pass from one network to the next without
//! a copy. Types and shapes are checked when a file is loaded (where the graph declares them) and
//! at every run.

use ort::session::{Session, SessionInputValue};
use ort::value::{DynValue, TensorElementType, ValueType};
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
}

/// Type of a tensor's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Float32,
    Int64,
}

/// What a tensor must be; `None` is any size, no shape at all is any shape.
#[derive(Clone, Debug)]
pub(super) struct Declared {
    kind: Kind,
    shape: Option<Vec<Option<usize>>>,
}

impl Declared {
    pub(super) fn new(kind: Kind, shape: &[Option<usize>]) -> Self {
        Self { kind, shape: Some(shape.to_vec()) }
    }

    /// Floats of exactly this shape.
    pub(super) fn floats<const N: usize>(shape: [usize; N]) -> Self {
        Self::new(Kind::Float32, &shape.map(Some))
    }

    /// Floats of any shape.
    pub(super) fn any() -> Self {
        Self { kind: Kind::Float32, shape: None }
    }

    /// Fails if `found` cannot be this; sizes that a graph leaves open (-1) may be anything.
    fn check(&self, tensor: &str, found: &ValueType) -> Result<(), NetworkError> {
        let kind = match self.kind {
            Kind::Float32 => TensorElementType::Float32,
            Kind::Int64 => TensorElementType::Int64,
        };
        let same_shape = match (&self.shape, found.tensor_shape()) {
            (Some(expected), Some(shape)) => {
                expected.len() == shape.len()
                    && expected.iter().zip(shape.iter()).all(|(&expected, &size)| {
                        size < 0 || expected.is_none_or(|expected| expected as i64 == size)
                    })
            }
            (None, Some(_)) => true,
            (_, None) => false,
        };
        if same_shape && found.tensor_type() == Some(kind) {
            return Ok(());
        }
        Err(NetworkError::Tensor {
            tensor: tensor.into(),
            expected: self.to_string(),
            found: written(found),
        })
    }
}

impl std::fmt::Display for Declared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match self.kind {
            Kind::Float32 => "f32",
            Kind::Int64 => "i64",
        };
        let Some(shape) = &self.shape else { return f.write_str(kind) };
        let sizes: Vec<String> =
            shape.iter().map(|size| size.map_or("?".into(), |size| size.to_string())).collect();
        write!(f, "{kind}[{}]", sizes.join(", "))
    }
}

/// Type and shape of what a graph has, as [`Declared`] writes it.
fn written(found: &ValueType) -> String {
    let kind = found.tensor_type().map_or("no tensor".into(), |kind| kind.to_string());
    let sizes: Vec<String> = found
        .tensor_shape()
        .map(|shape| {
            shape.iter().map(|&s| if s < 0 { "?".into() } else { s.to_string() }).collect()
        })
        .unwrap_or_default();
    format!("{kind}[{}]", sizes.join(", "))
}

/// A dense tensor, row-major.
pub struct Tensor(DynValue);

impl Tensor {
    /// Floats; `data` has as many as `shape` says.
    ///
    /// # Panics
    /// If it has not.
    pub fn floats(shape: &[usize], data: Vec<f32>) -> Self {
        let shape: Vec<i64> = shape.iter().map(|&size| size as i64).collect();
        let tensor = ort::value::Tensor::from_array((shape, data));
        Self(tensor.expect("as many numbers as the shape says").into_dyn())
    }

    /// Integers; `data` has as many as `shape` says.
    ///
    /// # Panics
    /// If it has not.
    pub fn ints(shape: &[usize], data: Vec<i64>) -> Self {
        let shape: Vec<i64> = shape.iter().map(|&size| size as i64).collect();
        let tensor = ort::value::Tensor::from_array((shape, data));
        Self(tensor.expect("as many numbers as the shape says").into_dyn())
    }

    /// The numbers of a tensor that a network gave as floats.
    pub fn as_floats(&self) -> &[f32] {
        let (_, data) =
            self.0.try_extract_tensor().expect("the network's outputs are checked to be floats");
        data
    }

    /// A copy of [`Self::as_floats`].
    pub fn into_floats(self) -> Vec<f32> {
        self.as_floats().to_vec()
    }

    /// The sizes.
    pub fn shape(&self) -> Vec<usize> {
        let shape = self.0.dtype().tensor_shape().expect("only tensors are made");
        shape.iter().map(|&size| size as usize).collect()
    }
}

/// One ONNX file with the inputs and outputs that are used of it, in the manifest's order.
pub struct Network {
    session: Session,
    inputs: Vec<(String, Declared)>,
    outputs: Vec<(String, Declared)>,
}

impl Network {
    /// Loads a graph and checks the tensors it declares. `threads` 0: one for each core.
    pub(super) fn load(
        runtime: &Runtime,
        bytes: &[u8],
        threads: usize,
        inputs: Vec<(String, Declared)>,
        outputs: Vec<(String, Declared)>,
    ) -> Result<Self, NetworkError> {
        // Idle threads must not spin: the renderer wants the cores.
        let session = Session::builder(&runtime.0)?
            .with_intra_threads(threads)?
            .with_intra_op_spinning(false)?
            .commit_from_memory(bytes)?;
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
        Ok(Self { session, inputs, outputs })
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
    pub fn run(&mut self, inputs: Vec<Tensor>) -> Result<Vec<Tensor>, NetworkError> {
        assert_eq!(inputs.len(), self.inputs.len(), "a tensor for each input");
        for ((name, declared), tensor) in self.inputs.iter().zip(&inputs) {
            declared.check(name, tensor.0.dtype())?;
        }
        let fed: Vec<(Cow<'_, str>, SessionInputValue<'_>)> = self
            .inputs
            .iter()
            .zip(inputs)
            .map(|((name, _), tensor)| (Cow::from(name.as_str()), tensor.0.into()))
            .collect();
        let mut found = self.session.run(fed)?;
        self.outputs
            .iter()
            .map(|(name, declared)| {
                let value = found.remove(name).expect("the graph was checked to have it");
                declared.check(name, value.dtype())?;
                Ok(Tensor(value))
            })
            .collect()
    }
}
