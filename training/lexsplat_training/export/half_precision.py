"""ONNX models in half precision."""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.transformers.float16 import convert_float_to_float16

COMPUTE = {"Conv", "ConvTranspose", "MatMul", "Gemm"}
LARGE = 1000  # weights with more values than this are stored in half precision


def stored(model):
    """Stores large weights as fp16 behind a Cast to fp32, in place; computes in fp32."""
    graph, casts = model.graph, []
    for weight in list(graph.initializer):
        if weight.data_type == TensorProto.FLOAT and np.prod(weight.dims) > LARGE:
            half = numpy_helper.to_array(weight).astype(np.float16)
            name = weight.name + ".half"
            graph.initializer.remove(weight)
            graph.initializer.append(numpy_helper.from_array(half, name))
            casts.append(helper.make_node("Cast", [name], [weight.name], to=TensorProto.FLOAT))
    nodes = casts + list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    return model


def computed(model):
    """Weights and computation in fp16.

    Inputs, outputs and everything after the last layer (division by the length) stay in fp32.
    """
    model = named(model)
    producers = {name: node for node in model.graph.node for name in node.output}
    ends, tail = [output.name for output in model.graph.output], set()
    while ends:
        node = producers.get(ends.pop())
        if node is not None and node.op_type not in COMPUTE and node.name not in tail:
            tail.add(node.name)
            ends.extend(node.input)
    model = convert_float_to_float16(model, keep_io_types=True, node_block_list=list(tail))
    # The conversion casts a tensor twice, to one name, if two nodes of the tail read it.
    unique = {tuple(node.output): node for node in model.graph.node}
    del model.graph.node[:]
    model.graph.node.extend(unique.values())
    return model


def named(model):
    """Gives every node a name of its own, in place."""
    for at, node in enumerate(model.graph.node):
        node.name = f"{at}.{node.op_type}"
    return model
