"""Changes of finished ONNX graphs: other names, other outputs, a compressor. Needs no PyTorch."""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from .folding import rename

OPSET = 17
SMALLEST = 1e-12  # length that a vector is divided by at least


def unit(graph, source, target, axis):
    """Appends nodes that scale `source` to unit length along an axis, as `target`."""
    constant(graph, f"{target}.smallest", np.float32(SMALLEST))
    length, bounded = f"{target}.length", f"{target}.bounded"
    squares, total = f"{target}.squares", f"{target}.total"
    constant(graph, f"{target}.axes", np.int64([axis]))
    graph.node.extend(
        [
            # Sums take their axes as an input in every opset from 13 on; norms only from 18 on.
            helper.make_node("Mul", [source, source], [squares]),
            helper.make_node("ReduceSum", [squares, f"{target}.axes"], [total], keepdims=1),
            helper.make_node("Sqrt", [total], [length]),
            helper.make_node("Max", [length, f"{target}.smallest"], [bounded]),
            helper.make_node("Div", [source, bounded], [target]),
        ]
    )


def constant(graph, name, value):
    """Adds a constant."""
    graph.initializer.append(numpy_helper.from_array(np.asarray(value), name))


def set_inputs(graph, shapes):
    """Gives inputs fixed shapes; `shapes`: name -> list of sizes."""
    for given in graph.input:
        if given.name in shapes:
            kind = given.type.tensor_type.elem_type
            given.CopyFrom(helper.make_tensor_value_info(given.name, kind, shapes[given.name]))


def set_output(graph, name, shape):
    """Makes a tensor of floats the only output, and drops what it does not need."""
    del graph.output[:]
    graph.output.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, shape))
    nodes, weights = needed(graph, name)
    for old, kept in ((graph.node, nodes), (graph.initializer, weights)):
        del old[:]
        old.extend(kept)
    del graph.value_info[:]  # shapes that were right for other inputs


def part(model, source, target):
    """The part of a model that computes the tensor `target` from the tensor `source`, of floats."""
    nodes, weights = needed(model.graph, target, source)
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        "part",
        [value(source, TensorProto.FLOAT, None)],
        [value(target, TensorProto.FLOAT, None)],
        weights,
    )
    made = helper.make_model(graph, opset_imports=model.opset_import)
    made.ir_version = model.ir_version
    return made


def needed(graph, target, source=None):
    """(nodes, constants) that a tensor is computed from, as far as the tensor `source`."""
    names, nodes = {target}, []
    for node in reversed(graph.node):
        if (names - {source}) & set(node.output):
            nodes.append(node)
            names.update(node.input)
            names.update(outer(node))
    return nodes[::-1], [weight for weight in graph.initializer if weight.name in names]


def outer(node):
    """Names that a node's subgraphs read."""
    for attribute in node.attribute:
        for graph in [attribute.g, *attribute.graphs]:
            for inner in graph.node:
                yield from inner.input
                yield from outer(inner)


def renamed(graph, names):
    """Renames tensors, in place, also where a new name is taken by another tensor."""
    every = {name for node in graph.node for name in (*node.input, *node.output)}
    every |= {value.name for value in (*graph.input, *graph.output, *graph.initializer)}
    taken = {new: f"{new}.before" for new in names.values() if new in every and new not in names}
    rename(graph, taken | names)


def compressed(model, directions):
    """A graph "features" [1, D, h, w] -> the same graph with codes [1, 32, h, w] of unit length.

    directions: orthonormal [32, D]. Changes the model in place.
    """
    graph = model.graph
    (features,) = graph.output
    _, _, rows, columns = (side.dim_value for side in features.type.tensor_type.shape.dim)
    constant(graph, "compressor", directions[:, :, None, None].astype(np.float32))
    graph.node.append(helper.make_node("Conv", [features.name, "compressor"], ["codes.raw"]))
    unit(graph, "codes.raw", "codes", 1)
    set_output(graph, "codes", [1, len(directions), rows, columns])
    return model


def decompressor(directions):
    """A graph: codes [n, 32] -> features [n, D] of unit length."""
    size, feature = directions.shape
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["codes", "directions"], ["features.raw"])],
        "decompress",
        [helper.make_tensor_value_info("codes", TensorProto.FLOAT, ["n", size])],
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["n", feature])],
    )
    constant(graph, "directions", directions.astype(np.float32))
    unit(graph, "features.raw", "features", 1)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = 8
    onnx.checker.check_model(model)
    return model
