"""SigLIP's towers that a hub has as ONNX graphs, changed to a feature for each patch.

SigLIP's head lets one query attend to all patches and passes what it gathered through an MLP. If
the query attends to a single patch it gathers W patch + b (as in MaskCLIP; Zhou et al. 2022), and
the MLP makes of it a feature in the space of the texts. Here every patch takes that way. W and b
are measured with the graph itself, because exports name and split their weights differently. All
other weights stay as they are, and PyTorch is not needed.
"""

import json

import numpy as np
import onnx
from onnx import helper
from tokenizers import Tokenizer

from ..command_line import InputError
from ..export import surgery
from ..export.bundle import Bundle
from ..runtime import session

PATCHES, POOLED = "last_hidden_state", "pooler_output"  # outputs of both towers
PIXELS, TOKENS = "pixel_values", "input_ids"  # their inputs
MEAN = STD = (127.5,) * 3
LEAST = 0.9999  # cosine of a patch's feature to the unchanged head's result for that patch
PICKING = {"Gather", "Slice", "Squeeze", "Reshape", "Identity"}  # nodes that pick the one query
BATCH = 8  # images that are measured at once


def convert(entry, files, out):
    """Writes features.onnx, text.onnx and tokenizer.json; returns (Bundle, least cosines)."""
    size, patch, tokens = (entry.options[key] for key in ("size", "patch", "tokens"))
    grid = tuple(side // patch for side in size)
    feature, cosine = write_features(files["vision"], size, grid, out / "features.onnx")
    onnx.save(text_tower(files["text"], tokens, feature), out / "text.onnx")
    tokenizer(files["tokenizer"], tokens).save(str(out / "tokenizer.json"))
    return Bundle(
        name=entry.name,
        licence=entry.licence,
        feature=feature,
        size=tuple(size),
        grid=grid,
        mean=MEAN,
        std=STD,
        context=tokens,
        antialias=True,
    ), {"features": cosine}


def write_features(path, size, grid, out):
    """Writes the image tower of the file `path` with a feature for each patch.

    size: rows and columns of the image; grid: of the patches. Returns (D, least cosine).
    """
    model = tower(path, PIXELS)
    head = surgery.part(model, PATCHES, POOLED)
    image = np.random.default_rng(0).normal(size=(1, 3, *size)).astype(np.float32)
    before = surgery.part(model, PIXELS, PATCHES)
    every = session.run(before.SerializeToString(), [image])[0]
    del before
    if every.shape[1] != grid[0] * grid[1]:
        raise InputError(f"{path}: expected {grid[0]}x{grid[1]} patches, found {every.shape[1]}")
    onnx.save(dense(model, size, grid, *every.shape[1:]), out)
    return every.shape[2], least_cosine(out, image, every, head)


def tower(path, given):
    """A graph with the outputs PATCHES and POOLED for the input `given`."""
    model = onnx.load(path)
    inputs = [value.name for value in model.graph.input]
    outputs = [value.name for value in model.graph.output]
    if inputs != [given] or {PATCHES, POOLED} - set(outputs):
        raise InputError(
            f"{path}: expected {given} -> {PATCHES}, {POOLED}; found {inputs} -> {outputs}"
        )
    return model


def dense(model, size, grid, count, feature):
    """An image tower with a feature for each of its `count` patches, changed in place.

    "image" [1, 3, height, width] -> "features" [1, D, rows, columns] of unit length.
    """
    graph = model.graph
    gathered, last = residual(graph)
    weight, bias = measured(surgery.part(model, PATCHES, gathered), count, feature)
    surgery.constant(graph, "patches.weight", weight)
    surgery.constant(graph, "patches.bias", bias)
    for node in graph.node:
        node.input[:] = ["patches.own" if name == gathered else name for name in node.input]
    at = next(k for k, node in enumerate(graph.node) if PATCHES in node.output)
    graph.node.insert(at + 1, helper.make_node("MatMul", [PATCHES, "patches.weight"], ["own.raw"]))
    own = helper.make_node("Add", ["own.raw", "patches.bias"], ["patches.own"])
    graph.node.insert(at + 2, own)
    surgery.constant(graph, "grid.shape", np.int64([1, feature, *grid]))
    turned = helper.make_node("Transpose", [last], ["grid.rows"], perm=[0, 2, 1])
    shaped = helper.make_node("Reshape", ["grid.rows", "grid.shape"], ["grid.features"])
    graph.node.extend([turned, shaped])
    surgery.unit(graph, "grid.features", "features", 1)
    surgery.set_inputs(graph, {PIXELS: [1, 3, *size]})
    surgery.set_output(graph, "features", [1, feature, *grid])
    surgery.renamed(graph, {PIXELS: "image"})
    return model


def residual(graph):
    """(what the query gathered, the head's result) of a head "gathered + mlp(gathered)"."""
    producers = {name: node for node in graph.node for name in node.output}
    node = producers[POOLED]
    while node.op_type in PICKING:
        node = producers[node.input[0]]
    if node.op_type == "Add":
        for gathered, other in (node.input, reversed(node.input)):
            if gathered in ancestors(producers, other):
                return gathered, node.output[0]
    raise InputError(f"the head of this SigLIP ends with {node.op_type}: expected x + mlp(x)")


def ancestors(producers, name):
    """The tensors that a tensor is computed from, as far as the patches."""
    found, open_ends = set(), [name]
    while open_ends:
        node = producers.get(open_ends.pop())
        fresh = set(node.input) - found - {PATCHES} if node else ()
        found.update(fresh)
        open_ends.extend(fresh)
    return found


def measured(attention, count, feature):
    """(W transposed [D, D], b [D]) of what the query gathers if all patches are the same.

    Attention to equal patches gathers one of them, whatever the query asks for.
    """
    run = session.session(attention.SerializeToString())
    inputs = np.concatenate([np.zeros((1, feature)), np.eye(feature)]).astype(np.float32)
    rows = []
    for start in range(0, len(inputs), BATCH):
        equal = np.repeat(inputs[start : start + BATCH, None], count, 1)
        rows.append(run.run(None, {PATCHES: equal})[0].reshape(len(equal), feature))
    rows = np.concatenate(rows)
    return rows[1:] - rows[0], rows[0]


def text_tower(path, tokens, feature):
    """A text tower for texts of `tokens` tokens: input_ids [1, tokens] -> embedding [1, D]."""
    model = tower(path, TOKENS)
    surgery.unit(model.graph, POOLED, "embedding", 1)
    surgery.set_inputs(model.graph, {TOKENS: [1, tokens]})
    surgery.set_output(model.graph, "embedding", [1, feature])
    return model


def least_cosine(path, image, every, head):
    """The least cosine of features to what the unchanged head makes of one patch at a time.

    image: a random input; every: its patches [1, n, D]; head: the unchanged graph behind them.
    """
    features = session.run(path, [image])[0][0]
    alone = session.session(head.SerializeToString())
    rows, cosines = features.reshape(len(features), -1).T, []
    for at in np.linspace(0, len(rows) - 1, 8).astype(int):
        equal = np.repeat(every[:, at : at + 1], len(rows), 1)
        wanted = alone.run(None, {PATCHES: equal})[0][0]
        cosines.append(float(rows[at] @ wanted / np.linalg.norm(wanted)))
    print(f"features: least cosine to the unchanged graphs {min(cosines):.6f}")
    if not min(cosines) >= LEAST:
        raise InputError(
            f"features.onnx: expected a cosine of at least {LEAST} to the unchanged graphs, found "
            f"{min(cosines):.6f}"
        )
    return min(cosines)


def tokenizer(path, tokens):
    """The tokenizer, which lower-cases texts, as SigLIP 2 was trained with, and cuts them."""
    made = json.loads(path.read_text())
    steps = [{"type": "Lowercase"}]
    if made.get("normalizer"):
        steps.append(made["normalizer"])
    made["normalizer"] = {"type": "Sequence", "normalizers": steps}
    loaded = Tokenizer.from_str(json.dumps(made))
    loaded.no_padding()  # the server fills with zeros, the number of SigLIP's <pad>
    loaded.enable_truncation(tokens)
    return loaded
