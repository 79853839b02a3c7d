//! Just enough of ONNX to make small graphs in a test, field by field (onnx.proto3).
//!
//! In: nodes, weights, names with types and shapes. Out: the bytes of a model, opset 17.

use half::f16;
use prost::Message;

/// Type of a tensor's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Single precision.
    F32 = 1,
    /// Tokens.
    I64 = 7,
    /// Half precision.
    F16 = 10,
}

#[derive(Clone, PartialEq, Message)]
struct Model {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
    #[prost(message, repeated, tag = "8")]
    opsets: Vec<Opset>,
}

#[derive(Clone, PartialEq, Message)]
struct Opset {
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, Message)]
struct Graph {
    #[prost(message, repeated, tag = "1")]
    nodes: Vec<Node>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    weights: Vec<Weight>,
    #[prost(message, repeated, tag = "11")]
    inputs: Vec<Value>,
    #[prost(message, repeated, tag = "12")]
    outputs: Vec<Value>,
}

/// An operation.
#[derive(Clone, PartialEq, Message)]
pub struct Node {
    #[prost(string, repeated, tag = "1")]
    inputs: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    outputs: Vec<String>,
    #[prost(string, tag = "4")]
    operator: String,
    #[prost(message, repeated, tag = "5")]
    attributes: Vec<Attribute>,
}

#[derive(Clone, PartialEq, Message)]
struct Attribute {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int64, optional, tag = "3")]
    integer: Option<i64>,
    #[prost(int64, repeated, tag = "8")]
    integers: Vec<i64>,
    #[prost(int32, tag = "20")]
    kind: i32,
}

/// A constant tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Weight {
    #[prost(int64, repeated, tag = "1")]
    sizes: Vec<i64>,
    #[prost(int32, tag = "2")]
    kind: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes, tag = "9")]
    numbers: Vec<u8>,
}

/// An input or an output.
#[derive(Clone, PartialEq, Message)]
pub struct Value {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<TypeOf>,
}

#[derive(Clone, PartialEq, Message)]
struct TypeOf {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorType>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorType {
    #[prost(int32, tag = "1")]
    kind: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<Shape>,
}

#[derive(Clone, PartialEq, Message)]
struct Shape {
    #[prost(message, repeated, tag = "1")]
    sizes: Vec<Size>,
}

#[derive(Clone, PartialEq, Message)]
struct Size {
    #[prost(int64, optional, tag = "1")]
    value: Option<i64>,
    #[prost(string, optional, tag = "2")]
    open: Option<String>,
}

/// An operation with attributes of whole numbers.
pub fn node(operator: &str, inputs: &[&str], output: &str, attributes: &[(&str, &[i64])]) -> Node {
    const INTEGER: i32 = 2;
    const INTEGERS: i32 = 7;
    // These take one number, all others that are used here take several.
    let single = ["axis", "p", "keepdims", "to"];
    let attributes = attributes.iter().map(|&(name, values)| {
        let name = name.to_owned();
        match single.contains(&name.as_str()) {
            true => {
                let integer = Some(values[0]);
                Attribute { name, integer, integers: vec![], kind: INTEGER }
            }
            false => Attribute { name, integer: None, integers: values.to_vec(), kind: INTEGERS },
        }
    });
    Node {
        inputs: inputs.iter().map(|&name| name.to_owned()).collect(),
        outputs: vec![output.into()],
        operator: operator.into(),
        attributes: attributes.collect(),
    }
}

/// A constant tensor, row-major.
pub fn weight(name: &str, kind: Kind, shape: &[usize], values: &[f32]) -> Weight {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}");
    let numbers = match kind {
        Kind::F32 => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        Kind::F16 => values.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()).collect(),
        Kind::I64 => values.iter().flat_map(|&value| (value as i64).to_le_bytes()).collect(),
    };
    let sizes = shape.iter().map(|&size| size as i64).collect();
    Weight { sizes, kind: kind as i32, name: name.into(), numbers }
}

/// An input or an output; `None` is a size that is open.
pub fn value(name: &str, kind: Kind, shape: &[Option<usize>]) -> Value {
    let size = |(at, size): (usize, &Option<usize>)| match size {
        Some(size) => Size { value: Some(*size as i64), open: None },
        None => Size { value: None, open: Some(format!("{name}_{at}")) },
    };
    let shape = Shape { sizes: shape.iter().enumerate().map(size).collect() };
    let tensor = TensorType { kind: kind as i32, shape: Some(shape) };
    Value { name: name.into(), kind: Some(TypeOf { tensor: Some(tensor) }) }
}

/// A model's bytes.
pub fn model(nodes: Vec<Node>, weights: Vec<Weight>, input: Value, output: Value) -> Vec<u8> {
    let graph =
        Graph { nodes, name: "made".into(), weights, inputs: vec![input], outputs: vec![output] };
    Model { ir_version: 9, graph: Some(graph), opsets: vec![Opset { version: 17 }] }.encode_to_vec()
}
