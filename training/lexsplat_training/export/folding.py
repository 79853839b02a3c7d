"""Fold a bundle's three image graphs (encoder, srd, compressor) into one, from image to codes.

The result computes the same up to rounding: constants are computed, batch norms become part of the
convolution before them, and so do 1x1 convolutions where that is less work. Weights that are stored
as fp16 become fp32. In the manifest, [vision] with `file`, `input = "image"`, `output = "codes"`
and `grid` then replaces [encoder], [srd] and `compressor.encoder`. Needs onnx and numpy only.
"""

import tomllib
from pathlib import Path

import numpy as np
import onnx
from onnx import compose, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

from ..command_line import parser

EXAMPLE = "--bundle ../models/tiny --out vision.onnx"
IMAGE, CODES = "image", "codes"
SKIPPED = {"DequantizeLinear", "RandomNormal", "RandomUniform"}  # would grow, or are not constant
CONVOLUTIONS = {"Conv", "ConvTranspose"}


def fold_bundle(folder):
    """One model of the three image graphs of a bundle's folder."""
    folder = Path(folder)
    manifest = tomllib.loads((folder / "manifest.toml").read_text())
    encoder, srd = manifest["encoder"], manifest["srd"]
    compress = manifest["compressor"]["encoder"]
    links = [
        dict(zip(encoder["outputs"], srd["inputs"], strict=True)),
        {srd["output"]: compress["input"]},
    ]
    files = [folder / part["file"] for part in (encoder, srd, compress)]
    return fold(files, links, {encoder["input"]: IMAGE}, {compress["output"]: CODES})


def fold(graphs, links, inputs, outputs):
    """One simplified model of several graphs in a row.

    graphs: models or files, in order. links: for each two neighbours, the outputs of the first and
    the inputs of the second that they feed. inputs, outputs: names in the first and last graph, and
    their names in the result.
    """
    models = [graph if isinstance(graph, onnx.ModelProto) else onnx.load(graph) for graph in graphs]
    if len(links) != len(models) - 1:
        raise ValueError(
            f"links: expected one less than graphs ({len(models)}), found {len(links)}"
        )
    model = compose.add_prefix(models[0], "0/")
    for at, (following, link) in enumerate(zip(models[1:], links, strict=True), start=1):
        following = compose.add_prefix(following, f"{at}/")
        io_map = [(f"{at - 1}/{out}", f"{at}/{into}") for out, into in link.items()]
        last = {out.name for out in following.graph.output} if at == len(models) - 1 else None
        model = compose.merge_models(
            model, following, io_map, outputs=sorted(last) if last else None
        )
    names = {f"0/{old}": new for old, new in inputs.items()}
    names |= {f"{len(models) - 1}/{old}": new for old, new in outputs.items()}
    rename(model.graph, names)
    return simplified(model)


def simplified(model):
    """A model with constants computed and batch norms and 1x1 convolutions folded."""
    graph = Graph(model)
    graph.drop_identities()
    graph.compute_constants()
    graph.fold_normalisations()
    graph.fold_pointwise()
    return graph.model()


def rename(graph, names):
    """Renames tensors, in place; `names`: old name -> new name."""
    for node in graph.node:
        node.input[:] = [names.get(name, name) for name in node.input]
        node.output[:] = [names.get(name, name) for name in node.output]
    for value in [*graph.input, *graph.output, *graph.initializer, *graph.value_info]:
        value.name = names.get(value.name, value.name)


def attributes(node):
    """A node's attributes as Python values."""
    return {attribute.name: helper.get_attribute_value(attribute) for attribute in node.attribute}


class Graph:
    """A model's nodes with its constants as arrays."""

    def __init__(self, model):
        self.source = model
        self.nodes = list(model.graph.node)
        self.constants = {w.name: numpy_helper.to_array(w) for w in model.graph.initializer}
        self.fixed = {output.name for output in model.graph.output}

    def consumers(self, name):
        """The nodes that read a tensor."""
        return [node for node in self.nodes if name in node.input]

    def only_consumer(self, name):
        """The only node that reads a tensor; None if there are more or it is an output."""
        readers = self.consumers(name)
        return readers[0] if len(readers) == 1 and name not in self.fixed else None

    def replace(self, old, new):
        """Lets all nodes that read the tensor `old` read `new`."""
        for node in self.nodes:
            node.input[:] = [new if name == old else name for name in node.input]

    def drop_identities(self):
        """Removes Identity nodes."""
        for node in [node for node in self.nodes if node.op_type == "Identity"]:
            if node.output[0] not in self.fixed:
                self.nodes.remove(node)
                self.replace(node.output[0], node.input[0])

    def compute_constants(self):
        """Replaces nodes that depend on constants only by their results."""
        for node in list(self.nodes):
            inputs = [name for name in node.input if name]
            constant = all(name in self.constants for name in inputs)
            if not constant or node.op_type in SKIPPED or self.fixed & set(node.output):
                continue
            opsets = self.source.opset_import
            values = {name: self.constants[name] for name in inputs}
            infos = [
                helper.make_tensor_value_info(
                    name, helper.np_dtype_to_tensor_dtype(value.dtype), value.shape
                )
                for name, value in values.items()
            ]
            outputs = [onnx.ValueInfoProto(name=name) for name in node.output]
            one = helper.make_model(
                helper.make_graph([node], "one", infos, outputs), opset_imports=opsets
            )
            results = ReferenceEvaluator(one).run(None, values)
            self.constants |= {
                name: np.asarray(v) for name, v in zip(node.output, results, strict=True)
            }
            self.nodes.remove(node)

    def weights(self, node):
        """(kernel, bias) of a convolution with constant weights; None otherwise."""
        if node.op_type not in CONVOLUTIONS or attributes(node).get("group", 1) != 1:
            return None
        if any(name not in self.constants for name in node.input[1:] if name):
            return None
        kernel = self.constants[node.input[1]]
        channels = kernel.shape[1 if node.op_type == "ConvTranspose" else 0]
        has_bias = len(node.input) > 2 and node.input[2]
        bias = self.constants[node.input[2]] if has_bias else np.zeros(channels, kernel.dtype)
        return kernel, bias

    def rewrite(self, first, second, kernel, bias):
        """Replaces `first` and `second` by `first` with these weights."""
        names = [first.output[0] + ".folded.weight", first.output[0] + ".folded.bias"]
        self.constants |= {
            name: np.ascontiguousarray(value, np.float32)
            for name, value in zip(names, (kernel, bias), strict=True)
        }
        del first.input[1:]
        first.input.extend(names)
        first.output[0] = second.output[0]
        self.nodes.remove(second)

    def fold_normalisations(self):
        """Folds batch norms: scale (W x + b - mean) / sqrt(var + eps) + shift has the same form."""
        for node in list(self.nodes):
            weights = self.weights(node)
            following = self.only_consumer(node.output[0])
            if weights is None or following is None or following.op_type != "BatchNormalization":
                continue
            if any(name not in self.constants for name in following.input[1:]):
                continue
            kernel, bias = (value.astype(np.float64) for value in weights)
            scale, shift, mean, var = (
                self.constants[name].astype(np.float64) for name in following.input[1:5]
            )
            factor = scale / np.sqrt(var + attributes(following).get("epsilon", 1e-5))
            along = (1, -1, 1, 1) if node.op_type == "ConvTranspose" else (-1, 1, 1, 1)
            self.rewrite(
                node, following, kernel * factor.reshape(along), (bias - mean) * factor + shift
            )

    def fold_pointwise(self):
        """Folds 1x1 convolutions: W2 (W1 x + b1) + b2 = (W2 W1) x + (W2 b1 + b2)."""
        for node in list(self.nodes):
            while node in self.nodes and (following := self.pointwise_behind(node)) is not None:
                (kernel, bias), (second, second_bias) = self.weights(node), self.weights(following)
                matrix = second[:, :, 0, 0].astype(np.float64)
                axes = "cm...,om->co..." if node.op_type == "ConvTranspose" else "mc...,om->oc..."
                kernel = np.einsum(axes, kernel.astype(np.float64), matrix)
                self.rewrite(node, following, kernel, matrix @ bias + second_bias)

    def pointwise_behind(self, node):
        """The 1x1 convolution after `node`, if folding it is possible and less work; or None."""
        weights, following = self.weights(node), self.only_consumer(node.output[0])
        if weights is None or following is None or following.op_type != "Conv":
            return None
        second, options = self.weights(following), attributes(following)
        plain = not any(options.get("pads", [0])) and set(options.get("strides", [1])) == {1}
        if second is None or second[0].shape[2:] != (1, 1) or not plain:
            return None
        out, middle = second[0].shape[:2]
        taps = weights[0].size // middle
        return following if taps * out <= taps * middle + middle * out else None

    def model(self):
        """The ONNX model, without nodes and weights that nothing reads."""
        needed, nodes = set(self.fixed), []
        for node in reversed(self.nodes):
            if needed & set(node.output):
                needed |= set(node.input)
                nodes.append(node)
        source = self.source.graph
        weights = [
            numpy_helper.from_array(np.asarray(value), name)
            for name, value in self.constants.items()
            if name in needed
        ]
        inputs = [value for value in source.input if value.name not in self.constants]
        graph = helper.make_graph(nodes[::-1], "folded", inputs, source.output, weights)
        model = helper.make_model(
            graph,
            opset_imports=self.source.opset_import,
            ir_version=self.source.ir_version,
            producer_name="lexsplat",
        )
        onnx.checker.check_model(model)
        return model


def arguments_parser():
    arguments = parser("fold-bundle", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--bundle", type=Path, required=True, help="folder of the bundle")
    add("--out", type=Path, required=True, help="ONNX file to write")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    model = fold_bundle(args.bundle)
    onnx.save(model, args.out)
    print(f"{args.out}: {len(model.graph.node)} nodes, {args.out.stat().st_size / 1e6:.1f} MB")
