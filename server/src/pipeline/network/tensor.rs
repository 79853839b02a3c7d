//! Tensors, and specifications of the tensors that a graph must have.
//!
//! Outside a graph, floats have single precision. A graph may use half precision: floats are
//! converted when they enter it and when its outputs are read.

use super::error::NetworkError;
use half::f16;
use ort::value::{DynValue, PrimitiveTensorElementType, TensorElementType, ValueType};
use std::borrow::Cow;

/// Type of a tensor's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ElementType {
    /// Single precision; in the graph it may be half precision.
    Float32,
    Int64,
}

/// Whether the type counts as [`ElementType::Float32`].
fn is_float(kind: TensorElementType) -> bool {
    matches!(kind, TensorElementType::Float32 | TensorElementType::Float16)
}

/// Required type and shape of a tensor.
#[derive(Clone, Debug)]
pub(super) struct TensorSpec {
    element_type: ElementType,
    /// `None`: any shape. An axis of `None`: any size.
    shape: Option<Vec<Option<usize>>>,
}

impl TensorSpec {
    pub(super) fn new(element_type: ElementType, shape: &[Option<usize>]) -> Self {
        Self { element_type, shape: Some(shape.to_vec()) }
    }

    /// Floats of exactly this shape.
    pub(super) fn floats<const N: usize>(shape: [usize; N]) -> Self {
        Self::new(ElementType::Float32, &shape.map(Some))
    }

    /// Floats of any shape.
    pub(super) fn any() -> Self {
        Self { element_type: ElementType::Float32, shape: None }
    }

    /// Fails if `found` does not match. Sizes that a graph leaves open (-1) match any size.
    pub(super) fn check(&self, tensor: &str, found: &ValueType) -> Result<(), NetworkError> {
        let same_type = match self.element_type {
            ElementType::Float32 => found.tensor_type().is_some_and(is_float),
            ElementType::Int64 => found.tensor_type() == Some(TensorElementType::Int64),
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
        if same_shape && same_type {
            return Ok(());
        }
        Err(NetworkError::Tensor {
            tensor: tensor.into(),
            expected: self.to_string(),
            found: describe(found),
        })
    }
}

impl std::fmt::Display for TensorSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match self.element_type {
            ElementType::Float32 => "f32",
            ElementType::Int64 => "i64",
        };
        let Some(shape) = &self.shape else { return f.write_str(kind) };
        let sizes: Vec<String> =
            shape.iter().map(|size| size.map_or("?".into(), |size| size.to_string())).collect();
        write!(f, "{kind}[{}]", sizes.join(", "))
    }
}

/// Type and shape in the graph, formatted as [`TensorSpec`] is.
fn describe(found: &ValueType) -> String {
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
    /// A tensor of floats.
    ///
    /// # Panics
    /// If the length of `data` is not the product of `shape`.
    pub fn floats(shape: &[usize], data: Vec<f32>) -> Self {
        Self::new(shape, data)
    }

    /// A tensor of integers.
    ///
    /// # Panics
    /// If the length of `data` is not the product of `shape`.
    pub(super) fn ints(shape: &[usize], data: Vec<i64>) -> Self {
        Self::new(shape, data)
    }

    fn new<T: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static>(
        shape: &[usize],
        data: Vec<T>,
    ) -> Self {
        let shape: Vec<i64> = shape.iter().map(|&size| size as i64).collect();
        let tensor = ort::value::Tensor::from_array((shape, data));
        Self(tensor.expect("the data has the size of the shape").into_dyn())
    }

    /// An output of a run.
    pub(super) fn from_value(value: DynValue) -> Self {
        Self(value)
    }

    /// An input of a run.
    pub(super) fn value(&self) -> &DynValue {
        &self.0
    }

    /// Elements of a tensor of floats, row-major. Only half precision is copied.
    pub fn as_floats(&self) -> Cow<'_, [f32]> {
        if let Ok((_, data)) = self.0.try_extract_tensor::<f32>() {
            return Cow::Borrowed(data);
        }
        let halves = self.0.try_extract_tensor::<f16>();
        let (_, data) = halves.expect("the type was checked when the graph ran");
        Cow::Owned(data.iter().map(|value| value.to_f32()).collect())
    }

    /// Mutable elements of a tensor that was made by [`Self::floats`].
    ///
    /// # Panics
    /// If it was made in another way.
    pub(crate) fn floats_mut(&mut self) -> &mut [f32] {
        let (_, data) =
            self.0.try_extract_tensor_mut().expect("the tensor was made by Self::floats");
        data
    }

    /// The same elements in the precision of a graph's input; `None` if no conversion is needed.
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

    /// Size of each axis.
    pub(crate) fn shape(&self) -> Vec<usize> {
        let shape = self.0.dtype().tensor_shape().expect("the value is a tensor");
        shape.iter().map(|&size| size as usize).collect()
    }
}
