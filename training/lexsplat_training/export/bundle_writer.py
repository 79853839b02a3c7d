"""Writes a bundle of large networks: ONNX files in fp32 or fp16, tokenizer and manifest.

Inputs and outputs are fp32 whatever the precision; text tokens are int64. The manifest is written
last, after ONNX Runtime agreed with PyTorch on every graph.
"""

import time
from dataclasses import dataclass

import numpy as np
import onnx
import torch
from torch import nn

from ..command_line import InputError
from ..constants import CODE_SIZE, NEGATIVES
from ..runtime import session
from . import half_precision
from .folding import simplified
from .graphs import export
from .manifest import Manifest

# least cosine of every code, feature and embedding to PyTorch's, by precision
LEAST = {"fp32": 0.9999, "fp16": 0.999}
SENTENCES = ("cup", "where is the coffee cup?", "a long text " * 12)  # checked


@dataclass
class Bundle:
    """How the networks of a bundle are used."""

    name: str
    licence: str
    feature: int
    size: tuple[int, int]  # rows, columns of the image
    grid: tuple[int, int]  # rows, columns of the codes
    mean: tuple[float, ...]  # of images in 0..255
    std: tuple[float, ...]
    context: int  # largest number of text tokens
    channel_order: str = "rgb"
    precision: str = "fp32"
    folded: bool = True  # one graph from image to codes, otherwise three

    @property
    def graphs(self):
        """Names of the image graphs."""
        return ["vision"] if self.folded else ["encoder", "srd", "compress"]

    @property
    def files(self):
        """All files but the manifest."""
        graphs = [*self.graphs, "decompress", "text"]
        return [f"{name}.onnx" for name in graphs] + ["tokenizer.json"]


class Vision(nn.Module):
    """Image [1, 3, h, w] -> codes [1, 32, rows, columns]: encoder, decoder, compressor."""

    def __init__(self, encoder, srd, compress):
        super().__init__()
        self.encoder, self.srd, self.compress = encoder, srd, compress

    def encoded(self, image):
        """The encoder's outputs as a tuple: coarse features, and skips if there are any."""
        coarse = self.encoder(image)
        return coarse if isinstance(coarse, tuple) else (coarse,)

    def forward(self, image):
        return self.compress(self.srd(*self.encoded(image)))


def write(out, bundle, vision, decoder, text, tokenizer):
    """Exports all networks, checks them against PyTorch and writes the folder `out`."""
    out.mkdir(parents=True, exist_ok=True)
    image = torch.randn(1, 3, *bundle.size, generator=torch.Generator().manual_seed(0))
    codes = torch.randn(64, CODE_SIZE, generator=torch.Generator().manual_seed(1))
    tokens = torch.tensor([tokenizer.encode(SENTENCES[1]).ids])
    rows = {"codes": {0: "n"}, "features": {0: "n"}}
    if bundle.folded:
        graphs = {"vision": simplified(export(vision, (image,), ["image"], ["codes"]))}
    else:
        graphs = stages(vision, image)
    graphs["decompress"] = export(decoder, (codes,), ["codes"], ["features"], rows)
    length = {"input_ids": {1: "tokens"}}
    graphs["text"] = export(text, (tokens,), ["input_ids"], ["embedding"], length)
    for name, model in graphs.items():
        model = half_precision.computed(model) if bundle.precision == "fp16" else model
        onnx.save(model, out / f"{name}.onnx")
    outputs = [value.name for value in graphs[bundle.graphs[0]].graph.output]
    del graphs
    tokenizer.save(str(out / "tokenizer.json"))
    with torch.inference_mode():
        check(out, bundle.precision, "vision", vision, image)
        check(out, bundle.precision, "decompress", decoder, codes)
        for sentence in SENTENCES:
            tokens = torch.tensor([tokenizer.encode(sentence).ids])
            check(out, bundle.precision, "text", text, tokens)
    manifest(bundle, outputs).write(out, bundle.files)


def stages(vision, image):
    """The three image graphs of an unfolded bundle, by name."""
    with torch.inference_mode():
        coarse = vision.encoded(image)
        features = vision.srd(*coarse)
    names = ["coarse", *(f"skip{at}" for at in range(1, len(coarse)))]
    return {
        "encoder": export(vision.encoder, (image,), ["image"], names),
        "srd": export(vision.srd, coarse, names, ["features"]),
        "compress": export(vision.compress, (features,), ["features"], ["codes"]),
    }


def run(folder, name, value):
    """A graph's first output; "vision" of an unfolded bundle is its three graphs in a row."""
    if name == "vision" and not (folder / "vision.onnx").exists():
        value = session.run(folder / "encoder.onnx", [value])
        value = session.run(folder / "srd.onnx", value)
        return session.run(folder / "compress.onnx", value)[0]
    return session.run(folder / f"{name}.onnx", [value])[0]


def check(folder, precision, name, module, value):
    """Compares PyTorch with ONNX Runtime, prints the least cosine, raises if it is too small."""
    wanted = module(value).double().numpy()
    started = time.time()
    found = run(folder, name, value.numpy()).astype(np.float64)
    length = np.linalg.norm(wanted, axis=1) * np.linalg.norm(found, axis=1)
    cosine = ((wanted * found).sum(1) / length).min()
    print(
        f"{name}: least cosine to torch {cosine:.6f} in {precision}, loaded and run in "
        f"{time.time() - started:.1f} s"
    )
    if not cosine >= LEAST[precision]:
        raise InputError(
            f"{name}.onnx: expected a cosine to torch of at least "
            f"{LEAST[precision]}, found {cosine:.6f}"
        )


def manifest(bundle, outputs):
    """The bundle's manifest; `outputs`: names of the first image graph's outputs."""
    grid = list(bundle.grid)
    compressor = {"decoder": {"file": "decompress.onnx", "input": "codes", "output": "features"}}
    if bundle.folded:
        vision = {"file": "vision.onnx", "input": "image", "output": "codes", "grid": grid}
        graphs = {"vision": vision}
    else:
        encoder = {"file": "encoder.onnx", "input": "image", "outputs": outputs}
        srd = {"file": "srd.onnx", "inputs": outputs, "output": "features", "grid": grid}
        graphs = {"encoder": encoder, "srd": srd}
        compress = {"file": "compress.onnx", "input": "features", "output": "codes"}
        compressor = {"encoder": compress, **compressor}
    return Manifest(
        name=bundle.name,
        version="1",
        licence=bundle.licence,
        feature_size=bundle.feature,
        code_size=CODE_SIZE,
        image={
            "width": bundle.size[1],
            "height": bundle.size[0],
            "fit": "squash",
            "channel_order": bundle.channel_order,
            "antialias": False,
            "mean": bundle.mean,
            "std": bundle.std,
        },
        graphs=graphs,
        compressor=compressor,
        text={
            "file": "text.onnx",
            "tokenizer": "tokenizer.json",
            "inputs": ["input_ids"],
            "output": "embedding",
            "max_tokens": bundle.context,
        },
        relevancy={"temperature": 10.0, "threshold": 0.5, "negatives": NEGATIVES},
    )
