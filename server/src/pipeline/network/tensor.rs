//! Tensors, and what a tensor of a graph must be.
//!
//! Outside a graph, floats are single precision; a graph may have them in half, and they are
//! converted where they enter and when they are read.

use super::runtime::NetworkError;
use half::f16;
use ort::value::{DynValue, PrimitiveTensorElementType, TensorElementType, ValueType};
use std::borrow::Cow;

/// Type of a tensor's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// In single precision, or as a graph has it in half.
    Float32,
    Int64,
}

/// Whether numbers of this type are taken as floats.
fn is_float(kind: TensorElementType) -> bool {
    matches!(kind, TensorElementType::Float32 | TensorElementType::Float16)
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
    pub(super) fn check(&self, tensor: &str, found: &ValueType) -> Result<(), NetworkError> {
        let same_kind = match self.kind {
            Kind::Float32 => found.tensor_type().is_some_and(is_float),
            Kind::Int64 => found.tensor_type() == Some(TensorElementType::Int64),
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
        if same_shape && same_kind {
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
        Self::new(shape, data)
    }

    /// Integers; `data` has as many as `shape` says.
    ///
    /// # Panics
    /// If it has not.
    pub fn ints(shape: &[usize], data: Vec<i64>) -> Self {
        Self::new(shape, data)
    }

    fn new<T: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static>(
        shape: &[usize],
        data: Vec<T>,
    ) -> Self {
        let shape: Vec<i64> = shape.iter().map(|&size| size as i64).collect();
        let tensor = ort::value::Tensor::from_array((shape, data));
        Self(tensor.expect("as many numbers as the shape says").into_dyn())
    }

    /// What a run gave.
    pub(super) fn from_value(value: DynValue) -> Self {
        Self(value)
    }

    /// What a run takes.
    pub(super) fn value(&self) -> &DynValue {
        &self.0
    }

    /// The numbers of a tensor of floats. Only those in half precision are copied.
    pub fn as_floats(&self) -> Cow<'_, [f32]> {
        if let Ok((_, data)) = self.0.try_extract_tensor::<f32>() {
            return Cow::Borrowed(data);
        }
        let halves = self.0.try_extract_tensor::<f16>();
        let (_, data) = halves.expect("tensors that are read as floats are checked to be floats");
        Cow::Owned(data.iter().map(|value| value.to_f32()).collect())
    }

    /// The numbers of a tensor that was made with [`Self::floats`], to be written over.
    ///
    /// # Panics
    /// If it was made otherwise.
    pub fn floats_mut(&mut self) -> &mut [f32] {
        let (_, data) = self.0.try_extract_tensor_mut().expect("it was made of floats");
        data
    }

    /// The same numbers in the precision that a graph takes; `None` if they are so already.
    pub(super) fn converted(&self, to: Option<TensorElementType>) -> Option<Self> {
        let from = self.0.dtype().tensor_type();
        if from == to || !from.is_some_and(is_float) {
            return None;
        }
        let (shape, floats) = (self.shape(), self.as_floats());
        match to {
            Some(TensorElementType::Float16) => {
                Some(Self::new(&shape, floats.iter().copied().map(f16::from_f32).collect()))
            }
            Some(TensorElementType::Float32) => Some(Self::floats(&shape, floats.into_owned())),
            _ => None,
        }
    }

    /// The sizes.
    pub fn shape(&self) -> Vec<usize> {
        let shape = self.0.dtype().tensor_shape().expect("only tensors are made");
        shape.iter().map(|&size| size as usize).collect()
    }
}
