"""Fold a chain of ONNX graphs into one that computes the same with less.

In:  the graphs in order (files or loaded models) and, between each two, which output feeds which
     input; or a bundle's folder, whose manifest says so.
Out: one model, image -> codes: what is constant is computed now, every BatchNormalization behind a
     convolution becomes part of it, and of two convolutions with nothing between them, the second
     1x1, one is left where that is less work. All exact up to rounding. Large weights of a folder's
     graphs that are stored as fp16 behind a Cast come out as fp32: `bundle.halve` stores them so again.

    python fold.py --bundle ../models/tiny --out vision.onnx      # needs onnx and numpy, no torch

For another script: `onnx.save(fold_bundle(folder), path)`; in the manifest, `[vision]` with `file`,
`input = "image"`, `output = "codes"` and `grid` then stands for `[encoder]`, `[srd]` and
`compressor.encoder`. The server takes either.
"""

import argparse
import tomllib
from pathlib import Path

import numpy as np
import onnx
from onnx import compose, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

IMAGE, CODES = "image", "codes"
SKIPPED = {"DequantizeLinear", "RandomNormal", "RandomUniform"}  # grow, or are not constant
CONVOLUTIONS = {"Conv", "ConvTranspose"}


def fold_bundle(folder):
    """The one graph of a bundle whose manifest has three: encoder, srd and compressor.encoder."""
    folder = Path(folder)
    manifest = tomllib.loads((folder / "manifest.toml").read_text())
    encoder, srd = manifest["encoder"], manifest["srd"]
    compress = manifest["compressor"]["encoder"]
    links = [dict(zip(encoder["outputs"], srd["inputs"], strict=True)),
             {srd["output"]: compress["input"]}]
    files = [folder / part["file"] for part in (encoder, srd, compress)]
    return fold(files, links, {encoder["input"]: IMAGE}, {compress["output"]: CODES})


def fold(graphs, links, inputs, outputs):
    """One simplified model of `graphs` in a row.

    links: for each neighbours, output of the first -> input of the second.
    inputs, outputs: names in the first and last graph -> names in the result.
    """
    models = [graph if isinstance(graph, onnx.ModelProto) else onnx.load(graph) for graph in graphs]
    if len(links) != len(models) - 1:
        raise ValueError(f"links: expected one less than graphs ({len(models)}), found {len(links)}")
    model = compose.add_prefix(models[0], "0/")
    for at, (following, link) in enumerate(zip(models[1:], links), start=1):
        following = compose.add_prefix(following, f"{at}/")
        io_map = [(f"{at - 1}/{out}", f"{at}/{into}") for out, into in link.items()]
        last = {out.name for out in following.graph.output} if at == len(models) - 1 else None
        model = compose.merge_models(model, following, io_map,
                                     outputs=sorted(last) if last else None)
    names = {f"0/{old}": new for old, new in inputs.items()}
    names |= {f"{len(models) - 1}/{old}": new for old, new in outputs.items()}
    rename(model.graph, names)
    return simplified(model)


def simplified(model):
    """Constants computed, normalisations and 1x1 convolutions folded, leftovers removed."""
    graph = Graph(model)
    graph.drop_identities()
    graph.compute_constants()
    graph.fold_normalisations()
    graph.fold_pointwise()
    return graph.model()


def rename(graph, names):
    """Give tensors other names."""
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
        """The one node that reads a tensor which nothing else sees; None otherwise."""
        readers = self.consumers(name)
        return readers[0] if len(readers) == 1 and name not in self.fixed else None

    def replace(self, old, new):
        """Let every reader of one tensor read another."""
        for node in self.nodes:
            node.input[:] = [new if name == old else name for name in node.input]

    def drop_identities(self):
        for node in [node for node in self.nodes if node.op_type == "Identity"]:
            if node.output[0] not in self.fixed:
                self.nodes.remove(node)
                self.replace(node.output[0], node.input[0])

    def compute_constants(self):
        """Run what depends on constants only."""
        for node in list(self.nodes):
            inputs = [name for name in node.input if name]
            constant = all(name in self.constants for name in inputs)
            if not constant or node.op_type in SKIPPED or self.fixed & set(node.output):
                continue
            opsets = self.source.opset_import
            values = {name: self.constants[name] for name in inputs}
            infos = [helper.make_tensor_value_info(
                name, helper.np_dtype_to_tensor_dtype(value.dtype), value.shape)
                for name, value in values.items()]
            outputs = [onnx.ValueInfoProto(name=name) for name in node.output]
            one = helper.make_model(helper.make_graph([node], "one", infos, outputs),
                                    opset_imports=opsets)
            results = ReferenceEvaluator(one).run(None, values)
            self.constants |= {name: np.asarray(v) for name, v in zip(node.output, results)}
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
        """`first` with these weights instead of `first`, then `second`."""
        names = [first.output[0] + ".folded.weight", first.output[0] + ".folded.bias"]
        self.constants |= {name: np.ascontiguousarray(value, np.float32)
                           for name, value in zip(names, (kernel, bias))}
        del first.input[1:]
        first.input.extend(names)
        first.output[0] = second.output[0]
        self.nodes.remove(second)

    def fold_normalisations(self):
        """W x + b, then scale (y - mean) / sqrt(var + eps) + shift: another W and b."""
        for node in list(self.nodes):
            weights = self.weights(node)
            following = self.only_consumer(node.output[0])
            if weights is None or following is None or following.op_type != "BatchNormalization":
                continue
            if any(name not in self.constants for name in following.input[1:]):
                continue
            kernel, bias = (value.astype(np.float64) for value in weights)
            scale, shift, mean, var = (self.constants[name].astype(np.float64)
                                       for name in following.input[1:5])
            factor = scale / np.sqrt(var + attributes(following).get("epsilon", 1e-5))
            along = (1, -1, 1, 1) if node.op_type == "ConvTranspose" else (-1, 1, 1, 1)
            self.rewrite(node, following, kernel * factor.reshape(along),
                         (bias - mean) * factor + shift)

    def fold_pointwise(self):
        """W2 (W1 x + b1) + b2 = (W2 W1) x + (W2 b1 + b2), where that is less work."""
        for node in list(self.nodes):
            while node in self.nodes and (following := self.pointwise_behind(node)) is not None:
                (kernel, bias), (second, second_bias) = self.weights(node), self.weights(following)
                matrix = second[:, :, 0, 0].astype(np.float64)
                axes = "cm...,om->co..." if node.op_type == "ConvTranspose" else "mc...,om->oc..."
                kernel = np.einsum(axes, kernel.astype(np.float64), matrix)
                self.rewrite(node, following, kernel, matrix @ bias + second_bias)

    def pointwise_behind(self, node):
        """The 1x1 convolution that can become part of `node` and is worth it; None otherwise."""
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
        """As ONNX again, without what nothing reads."""
        needed, nodes = set(self.fixed), []
        for node in reversed(self.nodes):
            if needed & set(node.output):
                needed |= set(node.input)
                nodes.append(node)
        source = self.source.graph
        weights = [numpy_helper.from_array(np.asarray(value), name)
                   for name, value in self.constants.items() if name in needed]
        inputs = [value for value in source.input if value.name not in self.constants]
        graph = helper.make_graph(nodes[::-1], "folded", inputs, source.output, weights)
        model = helper.make_model(graph, opset_imports=self.source.opset_import,
                                  ir_version=self.source.ir_version, producer_name="lexsplat")
        onnx.checker.check_model(model)
        return model


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bundle", type=Path, required=True, help="folder with three graphs")
    parser.add_argument("--out", type=Path, required=True, help="the ONNX file to write")
    args = parser.parse_args()
    model = fold_bundle(args.bundle)
    onnx.save(model, args.out)
    print(f"{args.out}: {len(model.graph.node)} nodes, {args.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
