"""Two image encoders as one: the graphs of models/tiny with a second encoder beside the first.

The features are unit(first + WEIGHT second): two networks that were trained differently also err
differently.
"""

from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, compose, helper
from torch.nn import functional as F

from ..command_line import parser
from ..constants import FEATURE_SIZE, IMAGE_SHAPE, MEAN, SECOND_SHAPE, STD, STRIDE
from ..networks.second_encoder import STRIDE as SECOND_STRIDE
from ..networks.second_encoder import load
from ..networks.vectors import unit
from ..runtime.bundle import Encoders
from . import graphs

WEIGHT = 0.6  # of the second encoder's features
EXAMPLE = """\
--first mean --trunk efficientnet-lite2.pth --head head/head.pt --out pair"""
GRID = tuple(side // STRIDE for side in IMAGE_SHAPE)


def resize(source, target, shape):
    """The node and the initializer that resize a map [1, C, h, w] to `shape` (rows, columns)."""
    name, channels = f"{target}.size", 3 if source == "image" else FEATURE_SIZE
    sizes = helper.make_tensor(name, TensorProto.INT64, [4], [1, channels, *shape])
    return helper.make_node("Resize", [source, "", "", name], [target], mode="linear"), sizes


def joined(first, second):
    """One graph from the image to the outputs of both encoders.

    first, second: ONNX models with the input `image`; the first one's is smaller, so that the image
    is resized for it. The second one's output is called `second`.
    """
    first, second = (
        compose.add_prefix(model, prefix, rename_outputs=False)
        for model, prefix in ((first, "first."), (second, "second."))
    )
    node, sizes = resize("image", "first.image", IMAGE_SHAPE)
    for one in second.graph.node:
        one.input[:] = ["image" if name == "second.image" else name for name in one.input]
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, *SECOND_SHAPE])
    graph = helper.make_graph(
        [node, *first.graph.node, *second.graph.node],
        "encoders",
        [image],
        [*first.graph.output, *second.graph.output],
        [sizes, *first.graph.initializer, *second.graph.initializer],
    )
    return model_of(graph, first)


def added(srd):
    """The first encoder's decoder with the second encoder's features added to its output."""
    srd = compose.add_prefix(srd, "first.", rename_inputs=False, rename_outputs=False)
    for node in srd.graph.node:
        node.output[:] = ["first" if name == "features" else name for name in node.output]
        node.input[:] = ["first" if name == "features" else name for name in node.input]
    node, sizes = resize("second", "second.small", GRID)
    nodes = [
        node,
        helper.make_node("LpNormalization", ["second.small"], ["second.unit"], axis=1, p=2),
        helper.make_node("Mul", ["second.unit", "second.weight"], ["second.weighed"]),
        helper.make_node("Add", ["first", "second.weighed"], ["both"]),
        helper.make_node("LpNormalization", ["both"], ["features"], axis=1, p=2),
    ]
    weight = helper.make_tensor("second.weight", TensorProto.FLOAT, [], [WEIGHT])
    rows, columns = (side // SECOND_STRIDE for side in SECOND_SHAPE)
    shape = [1, FEATURE_SIZE, rows, columns]
    taken = helper.make_tensor_value_info("second", TensorProto.FLOAT, shape)
    graph = helper.make_graph(
        [*srd.graph.node, *nodes],
        "srd",
        [*srd.graph.input, taken],
        srd.graph.output,
        [*srd.graph.initializer, sizes, weight],
    )
    return model_of(graph, srd)


def model_of(graph, like):
    """A checked model with the operator set of another."""
    model = helper.make_model(graph, opset_imports=like.opset_import, ir_version=like.ir_version)
    onnx.checker.check_model(model, full_check=True)
    return model


def compare(out, first, second):
    """The least cosine of the joined graphs to the first folder's and the second in PyTorch."""
    image = np.random.default_rng(0).integers(0, 255, (*SECOND_SHAPE, 3), dtype=np.uint8)
    found = Encoders(out)(image)
    x = (torch.from_numpy(image).permute(2, 0, 1)[None].float() - MEAN) / STD
    small = F.interpolate(x, IMAGE_SHAPE, mode="bilinear")[0].permute(1, 2, 0) * STD + MEAN
    own = torch.from_numpy(Encoders(first)(small.numpy())).permute(2, 0, 1)[None]
    with torch.inference_mode():
        other = unit(F.interpolate(second(x), GRID, mode="bilinear"), 1)
        wanted = unit(own + WEIGHT * other, 1)[0].permute(1, 2, 0).numpy()
    return (wanted * found).sum(-1).min()


def write(first, second, out):
    """Joins the graphs of the folder `first` with a SecondEncoder; returns the least cosine."""
    out.mkdir(parents=True, exist_ok=True)
    example = torch.zeros(1, 3, *SECOND_SHAPE)
    exported = graphs.export(second, (example,), ["image"], ["second"])
    onnx.save(joined(onnx.load(first / "encoder.onnx"), exported), out / "encoder.onnx")
    onnx.save(added(onnx.load(first / "srd.onnx")), out / "srd.onnx")
    return compare(out, first, second)


def arguments_parser():
    arguments = parser("join-encoders", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--first", type=Path, required=True, help="folder with encoder.onnx and srd.onnx")
    add("--trunk", type=Path, required=True, help="EfficientNet-Lite2's weights, a .pth file")
    add("--head", type=Path, required=True, help="head.pt, written by train-head")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    cosine = write(args.first, load(args.trunk, args.head), args.out)
    print(f"wrote {args.out}; ONNX against torch: least cosine {cosine:.5f}")
    assert cosine > 0.999
