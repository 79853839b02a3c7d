"""Modules of PyTorch as ONNX graphs."""

import tempfile
from pathlib import Path

import onnx
import torch

from ..command_line import InputError
from ..constants import CODE_SIZE, FEATURE_SIZE, IMAGE_SHAPE, STRIDE

OPSET = 17
LARGEST = 2_000_000_000  # bytes: an ONNX file is one protobuf message


def write(module, path, example, inputs, outputs, dynamic=None):
    """Writes a module as ONNX file.

    example: inputs to trace with; inputs, outputs: their names; dynamic: {name: {axis: name}}.
    """
    torch.onnx.export(
        module,
        example,
        str(path),
        input_names=inputs,
        output_names=outputs,
        dynamic_axes=dynamic,
        opset_version=OPSET,
        dynamo=False,
    )


def export(module, example, inputs, outputs, dynamic=None):
    """A module as ONNX model in memory; arguments as of `write`."""
    size = sum(weight.numel() for weight in module.parameters()) * 4
    if size > LARGEST:
        raise InputError(
            f"{type(module).__name__} has {size / 1e9:.1f} GB of weights: expected at "
            f"most {LARGEST / 1e9:.0f} GB in one file; take a smaller model"
        )
    with tempfile.TemporaryDirectory() as folder, torch.inference_mode():
        path = Path(folder) / "model.onnx"
        write(module, path, example, inputs, outputs, dynamic)
        return onnx.load(path)


def export_encoder(encoder, decoder, folder):
    """Writes models/tiny's encoder.onnx and srd.onnx, for one image of the bundle's size."""
    example = torch.zeros(1, 3, *IMAGE_SHAPE)
    names = ["coarse", "skip8", "skip4"]
    encoder.eval()
    decoder.eval()
    with torch.inference_mode():
        maps = encoder(example)
    write(encoder, folder / "encoder.onnx", (example,), ["image"], names)
    write(decoder, folder / "srd.onnx", tuple(m.clone() for m in maps), names, ["features"])


def export_compressor(compress, decompress, folder):
    """Writes models/tiny's compress.onnx, and decompress.onnx for any number of codes."""
    height, width = (side // STRIDE for side in IMAGE_SHAPE)
    features, codes = torch.zeros(1, FEATURE_SIZE, height, width), torch.zeros(2, CODE_SIZE)
    rows = {"codes": {0: "n"}, "features": {0: "n"}}
    write(compress.eval(), folder / "compress.onnx", (features,), ["features"], ["codes"])
    write(decompress.eval(), folder / "decompress.onnx", (codes,), ["codes"], ["features"], rows)
