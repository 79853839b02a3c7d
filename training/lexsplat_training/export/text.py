"""Export the sentence encoder all-MiniLM-L6-v2 as the text tower of models/tiny.

The embeddings are centred on a vocabulary, the large weights stored as int8. Writes text.onnx
(input_ids, attention_mask, token_type_ids [1, t] -> embedding [1, D] of unit length) and
tokenizer.json.
"""

import json
import time
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from tokenizers import Tokenizer

from ..command_line import parser
from ..constants import NEGATIVES
from ..networks.sentence_encoder import embed, load_tower
from ..runtime.text_encoder import INPUTS, MAX_TOKENS, TextEncoder
from .graphs import write

EXAMPLE = "--model all-MiniLM-L6-v2 --vocabulary nouns.json --out text"
LARGE = 10_000  # matrices with more values than this are quantised


def write_tokenizer(source, target):
    """Copies a tokenizer, without padding and cut at MAX_TOKENS; returns it."""
    tokenizer = Tokenizer.from_file(str(source))
    tokenizer.no_padding()
    tokenizer.enable_truncation(MAX_TOKENS)
    tokenizer.save(str(target))
    return tokenizer


def quantise(source, target):
    """Copies a graph with large matrices as int8, one scale per column; activations stay fp32.

    An embedding table is gathered as int8 and scaled afterwards; a matrix is scaled before use.
    """
    model = onnx.load(source)
    graph, nodes = model.graph, []
    matrices = [weight for weight in graph.initializer if len(weight.dims) == 2]
    large = {weight.name: weight for weight in matrices if np.prod(weight.dims) > LARGE}
    for node in graph.node:
        used = [name for name in node.input if name in large]
        if not used:
            nodes.append(node)
            continue
        (name,) = used
        graph.initializer.remove(large[name])
        graph.initializer.extend(quantised(name, numpy_helper.to_array(large[name])))
        parameters = [name + ".scale", name + ".zero"]
        if node.op_type == "Gather":
            result, raw = node.output[0], node.output[0] + ".int8"
            node.input[0], node.output[0] = name + ".int8", raw
            scaling = helper.make_node("DequantizeLinear", [raw, *parameters], [result], axis=-1)
            nodes += [node, scaling]
        else:
            inputs = [name + ".int8", *parameters]
            nodes += [helper.make_node("DequantizeLinear", inputs, [name], axis=1), node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    onnx.save(model, target)


def quantised(name, weight):
    """A matrix as three tensors: int8 values, and a scale and zero point per column."""
    scale = np.abs(weight).max(0).clip(1e-8) / 127
    values = {
        ".int8": (weight / scale).round().astype(np.int8),
        ".scale": scale.astype(np.float32),
        ".zero": np.zeros(len(scale), np.int8),
    }
    return [numpy_helper.from_array(value, name + suffix) for suffix, value in values.items()]


def arguments_parser():
    arguments = parser("export-text", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--model", type=Path, required=True, help="folder of the sentence encoder")
    add("--vocabulary", type=Path, required=True, help="nouns.json")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    started = time.time()
    args.out.mkdir(parents=True, exist_ok=True)
    tokenizer = write_tokenizer(args.model / "tokenizer.json", args.out / "tokenizer.json")
    tower = load_tower(args.model)
    nouns = [row["name"] for row in json.loads(args.vocabulary.read_text())]
    tower.centre.copy_(embed(tower, tokenizer, nouns).mean(0))
    example = tuple(torch.ones(1, 6, dtype=torch.int64) for _ in INPUTS)
    lengths = {name: {1: "tokens"} for name in INPUTS}
    write(tower, args.out / "text.fp32.onnx", example, INPUTS, ["embedding"], lengths)
    quantise(args.out / "text.fp32.onnx", args.out / "text.onnx")
    (args.out / "text.fp32.onnx").unlink()
    texts = [*nouns[::10], *NEGATIVES, "where is the coffee cup?"]
    full, small = embed(tower, tokenizer, texts).numpy(), TextEncoder(args.out)(texts)
    cosine = (full * small).sum(1)
    between = np.abs(small @ small.T)[np.triu_indices(len(texts), 1)]
    print(
        f"int8 against fp32 cosine: mean {cosine.mean():.4f} least {cosine.min():.4f}; "
        f"|cosine| between nouns: median {np.median(between):.3f}; {time.time() - started:.0f} s"
    )
