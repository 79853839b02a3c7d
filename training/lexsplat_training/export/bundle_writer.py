"""Writes a bundle of large networks: ONNX files in fp32 or fp16, tokenizer and manifest.

Inputs and outputs are fp32 whatever the precision; text tokens are int64. The manifest is written
last, after ONNX Runtime agreed with PyTorch on every graph.
"""

import time

import numpy as np
import onnx
import torch
from torch import nn

from ..command_line import InputError
from ..constants import CODE_SIZE
from ..runtime import session
from . import half_precision
from .bundle import manifest
from .folding import simplified
from .graphs import export

# least cosine of every code, feature and embedding to PyTorch's, by precision
LEAST = {"fp32": 0.9999, "fp16": 0.999}
SENTENCES = ("cup", "where is the coffee cup?", "a long text " * 12)  # checked


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
    """Exports all networks, checks them against PyTorch and writes the folder `out`.

    Returns the least cosine to PyTorch of each graph, by its name.
    """
    out.mkdir(parents=True, exist_ok=True)
    image = sample(bundle.size)
    codes = torch.randn(64, CODE_SIZE, generator=torch.Generator().manual_seed(1))
    rows = {"codes": {0: "n"}, "features": {0: "n"}}
    if bundle.folded:
        graphs = {"vision": simplified(export(vision, (image,), ["image"], ["codes"]))}
    else:
        graphs = stages(vision, image)
    graphs["decompress"] = export(decoder, (codes,), ["codes"], ["features"], rows)
    graphs["text"] = text_graph(text, tokenizer)
    for name, model in graphs.items():
        model = half_precision.computed(model) if bundle.precision == "fp16" else model
        onnx.save(model, out / f"{name}.onnx")
    outputs = [value.name for value in graphs[bundle.graphs[0]].graph.output]
    del graphs
    tokenizer.save(str(out / "tokenizer.json"))
    with torch.inference_mode():
        found = {
            "vision": check(out, bundle.precision, "vision", vision, image),
            "decompress": check(out, bundle.precision, "decompress", decoder, codes),
            "text": check_text(out, bundle.precision, text, tokenizer),
        }
    manifest(bundle, outputs).write(out, bundle.files)
    return found


def write_towers(out, encoder, text, tokenizer, size):
    """Writes features.onnx (image -> features), text.onnx and tokenizer.json in fp32, checked.

    size: rows and columns of the image. Returns the least cosines to PyTorch as `write` does.
    """
    out.mkdir(parents=True, exist_ok=True)
    image = sample(size)
    features = simplified(export(encoder, (image,), ["image"], ["features"]))
    onnx.save(features, out / "features.onnx")
    del features
    onnx.save(text_graph(text, tokenizer), out / "text.onnx")
    tokenizer.save(str(out / "tokenizer.json"))
    with torch.inference_mode():
        return {
            "features": check(out, "fp32", "features", encoder, image),
            "text": check_text(out, "fp32", text, tokenizer),
        }


def sample(size):
    """A random image [1, 3, rows, columns]."""
    return torch.randn(1, 3, *size, generator=torch.Generator().manual_seed(0))


def text_graph(text, tokenizer):
    """The text tower as ONNX model for any number of tokens."""
    tokens = torch.tensor([tokenizer.encode(SENTENCES[1]).ids])
    length = {"input_ids": {1: "tokens"}}
    return export(text, (tokens,), ["input_ids"], ["embedding"], length)


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
    """The least cosine of ONNX Runtime's result to PyTorch's; raises if it is too small."""
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
    return float(cosine)


def check_text(folder, precision, text, tokenizer):
    """The least cosine of `check` over SENTENCES."""
    tokens = [torch.tensor([tokenizer.encode(sentence).ids]) for sentence in SENTENCES]
    return min(check(folder, precision, "text", text, ids) for ids in tokens)
