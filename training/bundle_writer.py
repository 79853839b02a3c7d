"""Write a bundle of exported networks: ONNX files in fp32 or fp16, tokenizer, manifest, and a check.

In:  a Vision (encoder, srd, compress), a decoder, a text tower, a tokenizer, and a Bundle that says
     how they are used.
Out: a folder that `lexsplat-server --models` loads. Folded, its manifest has `[vision]`: one graph
     from image to codes; otherwise `[encoder]`, `[srd]` and `compressor.encoder`. Inputs and outputs
     are fp32 whatever the precision; text tokens are int64.

Nothing is written under its name before ONNX Runtime agrees with torch (see `LEAST`).
"""

import hashlib
import json
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnxruntime.transformers.float16 import convert_float_to_float16
from torch import nn

import fold
from published import CODE

OPSET = 17
LEAST = {"fp32": 0.9999, "fp16": 0.999}  # cosine of every code, feature and embedding to torch's
LARGEST = 2_000_000_000  # bytes: an ONNX file is one protobuf message
NEGATIVES = ("object", "things", "stuff", "texture")
COMPUTE = {"Conv", "ConvTranspose", "MatMul", "Gemm"}


@dataclass
class Bundle:
    """What the manifest says beside the files."""

    name: str
    licence: str
    feature: int
    size: tuple[int, int]  # rows, columns of the image
    grid: tuple[int, int]
    mean: tuple[float, ...]
    std: tuple[float, ...]
    context: int
    channel_order: str = "rgb"
    fit: str = "squash"
    temperature: float = 10.0
    threshold: float = 0.5
    negatives: tuple[str, ...] = NEGATIVES
    precision: str = "fp32"
    folded: bool = True
    files: list[str] = field(default_factory=list)


class Vision(nn.Module):
    """Image to codes in one."""

    def __init__(self, encoder, srd, compress):
        super().__init__()
        self.encoder, self.srd, self.compress = encoder, srd, compress

    def forward(self, image):
        coarse = self.encoder(image)
        coarse = coarse if isinstance(coarse, tuple) else (coarse,)
        return self.compress(self.srd(*coarse))


def export(module, example, inputs, outputs, dynamic=None):
    """A module as an ONNX model with its weights in it."""
    size = sum(weight.numel() for weight in module.parameters()) * 4
    if size > LARGEST:
        raise ValueError(f"{type(module).__name__} has {size / 1e9:.1f} GB of weights: expected at "
                         f"most {LARGEST / 1e9:.0f} GB in one file; take a smaller model")
    with tempfile.TemporaryDirectory() as folder, torch.inference_mode():
        path = Path(folder) / "model.onnx"
        torch.onnx.export(module, example, str(path), opset_version=OPSET, input_names=inputs,
                          output_names=outputs, dynamic_axes=dynamic, dynamo=False)
        return onnx.load(path)


def halved(model):
    """Weights and computation in fp16; inputs, outputs and what follows the last layer (the division
    by the length) in fp32."""
    producers = {name: node for node in model.graph.node for name in node.output}
    ends, tail = [output.name for output in model.graph.output], set()
    while ends:
        node = producers.get(ends.pop())
        if node is not None and node.op_type not in COMPUTE and node.name not in tail:
            tail.add(node.name)
            ends.extend(node.input)
    model = convert_float_to_float16(model, keep_io_types=True, node_block_list=list(tail))
    # A tensor that two of the tail's nodes read is cast twice, to one name.
    unique = {tuple(node.output): node for node in model.graph.node}
    del model.graph.node[:]
    model.graph.node.extend(unique.values())
    return model


def named(model):
    """Every node with a name of its own."""
    for at, node in enumerate(model.graph.node):
        node.name = f"{at}.{node.op_type}"
    return model


def write(out, bundle, vision, decoder, text, tokenizer):
    """Export, check against torch, and write the folder. The least cosines are printed."""
    out.mkdir(parents=True, exist_ok=True)
    rows, columns = bundle.size
    image = torch.randn(1, 3, rows, columns, generator=torch.Generator().manual_seed(0))
    tokens = torch.tensor([tokenizer.encode("where is the coffee cup?").ids])
    codes = torch.randn(64, CODE, generator=torch.Generator().manual_seed(1))
    if bundle.folded:
        graphs = {"vision": ([image], fold.simplified(
            export(vision, (image,), ["image"], ["codes"])))}
    else:
        graphs = stages(vision, image)
    graphs["decompress"] = ([codes], export(
        decoder, (codes,), ["codes"], ["features"],
        {"codes": {0: "n"}, "features": {0: "n"}}))
    graphs["text"] = ([tokens], export(text, (tokens,), ["input_ids"], ["embedding"],
                                       {"input_ids": {1: "tokens"}}))
    for name, (_, model) in graphs.items():
        model = halved(named(model)) if bundle.precision == "fp16" else model
        onnx.save(model, out / f"{name}.onnx")
    sizes = {name: [value.name for value in model.graph.output] for name, (_, model)
             in graphs.items()}
    del graphs
    tokenizer.save(str(out / "tokenizer.json"))
    bundle.files = [f"{name}.onnx" for name in sizes] + ["tokenizer.json"]
    with torch.inference_mode():
        check(out, bundle.precision, "vision", vision, image)
        check(out, bundle.precision, "decompress", decoder, codes)
        for words in ("cup", "where is the coffee cup?", "a long text " * 12):
            check(out, bundle.precision, "text", text,
                  torch.tensor([tokenizer.encode(words).ids]))
    (out / "manifest.toml").write_text(manifest(out, bundle, sizes))


def stages(vision, image):
    """The three graphs of an unfolded bundle, each with its example."""
    with torch.inference_mode():
        coarse = vision.encoder(image)
        coarse = coarse if isinstance(coarse, tuple) else (coarse,)
        features = vision.srd(*coarse)
    names = ["coarse", *(f"skip{at}" for at in range(1, len(coarse)))]
    return {
        "encoder": ([image], export(vision.encoder, (image,), ["image"], names)),
        "srd": (list(coarse), export(vision.srd, tuple(coarse), names, ["features"])),
        "compress": ([features], export(vision.compress, (features,), ["features"], ["codes"])),
    }


def run(folder, name, value):
    """A graph's first output; `vision` of three graphs is all of them in a row."""
    if name == "vision" and not (folder / "vision.onnx").exists():
        value = run_all(folder / "encoder.onnx", [value])
        value = run_all(folder / "srd.onnx", value)
        return run_all(folder / "compress.onnx", value)[0]
    return run_all(folder / f"{name}.onnx", [value])[0]


def run_all(path, values):
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    names = [value.name for value in session.get_inputs()]
    return session.run(None, dict(zip(names, values, strict=True)))


def check(folder, precision, name, module, value):
    """Torch against ONNX Runtime: raises where they disagree."""
    wanted = module(value).double().numpy()
    started = time.time()
    found = run(folder, name, value.numpy()).astype(np.float64)
    length = np.linalg.norm(wanted, axis=1) * np.linalg.norm(found, axis=1)
    cosine = ((wanted * found).sum(1) / length).min()
    print(f"{name}: least cosine to torch {cosine:.6f} in {precision}, loaded and run in "
          f"{time.time() - started:.1f} s")
    if not cosine >= LEAST[precision]:
        raise ValueError(f"{name}.onnx: expected a cosine to torch of at least "
                         f"{LEAST[precision]}, found {cosine:.6f}")


def manifest(folder, bundle, outputs):
    """manifest.toml, with the SHA-256 of every file."""
    text = json.dumps  # a string or a list of strings is the same in TOML
    grid = list(bundle.grid)
    if bundle.folded:
        vision = ["[vision]", 'file = "vision.onnx"', 'input = "image"', 'output = "codes"',
                  f"grid = {grid}"]
        compress = []
    else:
        names = text(outputs["encoder"])
        vision = ["[encoder]", 'file = "encoder.onnx"', 'input = "image"', f"outputs = {names}", "",
                  "[srd]", 'file = "srd.onnx"', f"inputs = {names}", 'output = "features"',
                  f"grid = {grid}"]
        compress = ['encoder = { file = "compress.onnx", input = "features", output = "codes" }']
    checksums = [f'"{name}" = "{hashlib.sha256((folder / name).read_bytes()).hexdigest()}"'
                 for name in bundle.files]
    lines = [
        f"name = {text(bundle.name)}", 'version = "1"', f"licence = {text(bundle.licence)}",
        f"feature_size = {bundle.feature}", f"code_size = {CODE}", "",
        "[image]", f"width = {bundle.size[1]}", f"height = {bundle.size[0]}",
        f"fit = {text(bundle.fit)}", f"channel_order = {text(bundle.channel_order)}",
        "antialias = false", f"mean = {list(bundle.mean)}", f"std = {list(bundle.std)}", "",
        *vision, "", "[compressor]", *compress,
        'decoder = { file = "decompress.onnx", input = "codes", output = "features" }', "",
        "[text]", 'file = "text.onnx"', 'tokenizer = "tokenizer.json"', 'inputs = ["input_ids"]',
        'output = "embedding"', f"max_tokens = {bundle.context}", "",
        "[relevancy]", f"temperature = {bundle.temperature}", f"threshold = {bundle.threshold}",
        f"negatives = {text(list(bundle.negatives))}", "", "[sha256]", *checksums, ""]
    return "\n".join(lines)
