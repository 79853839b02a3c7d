"""Assemble the bundle models/tiny: ONNX files, tokenizer and manifest.

Takes the folders that export-text, join-encoders (or train-encoder) and train-compressor wrote.
Large weights of the image networks are stored as fp16 and cast to fp32 when they are loaded; inputs
and outputs are fp32. The result is compared with the graphs that it was made of.
"""

import shutil
import time
from pathlib import Path

import numpy as np
import onnx

from ..command_line import parser
from ..constants import CODE_SIZE, FEATURE_SIZE, MEAN, NEGATIVES, STD
from ..runtime.bundle import Bundle, Encoders
from ..runtime.text_encoder import INPUTS, MAX_TOKENS
from . import half_precision
from .manifest import Manifest

LARGEST = 64  # MB
EXAMPLE = """\
--text text --encoder pair --compressor compressor --version 5 \\
      --bias 2.9 --present 0.62 --steepness 10.9 --out ../models/tiny"""


def sources(args):
    """The source folder of every file of the bundle, in the manifest's order."""
    return {
        "encoder.onnx": args.encoder,
        "srd.onnx": args.encoder,
        "compress.onnx": args.compressor,
        "decompress.onnx": args.compressor,
        "text.onnx": args.text,
        "tokenizer.json": args.text,
    }


def shapes(graph):
    """{name: [size along each axis]} of a graph's inputs and outputs."""
    values = [*graph.input, *graph.output]
    return {v.name: [axis.dim_value for axis in v.type.tensor_type.shape.dim] for v in values}


def manifest(args, encoder, srd):
    """The bundle's manifest; encoder, srd: the graphs."""
    maps = [output.name for output in encoder.output]
    (height, width), grid = shapes(encoder)["image"][2:], shapes(srd)["features"][2:]
    return Manifest(
        name=args.out.name,
        version=args.version,
        licence="Apache-2.0",
        feature_size=FEATURE_SIZE,
        code_size=CODE_SIZE,
        image={
            "width": width,
            "height": height,
            "fit": "squash",
            "channel_order": "rgb",
            "mean": [MEAN] * 3,
            "std": [STD] * 3,
        },
        graphs={
            "encoder": {"file": "encoder.onnx", "input": "image", "outputs": maps},
            "srd": {"file": "srd.onnx", "inputs": maps, "output": "features", "grid": grid},
        },
        compressor={
            "encoder": {"file": "compress.onnx", "input": "features", "output": "codes"},
            "decoder": {"file": "decompress.onnx", "input": "codes", "output": "features"},
        },
        text={
            "file": "text.onnx",
            "tokenizer": "tokenizer.json",
            "inputs": INPUTS,
            "output": "embedding",
            "max_tokens": MAX_TOKENS,
        },
        relevancy={
            "temperature": args.temperature,
            "bias": args.bias,
            "threshold": args.threshold,
            "negatives": NEGATIVES,
            "present_threshold": args.present,
            "confidence_steepness": args.steepness,
        },
    )


def check(out, encoders, files):
    """Compares features with those of the source graphs; prints cosine, size and time per frame."""
    bundle, source = Bundle(out), Encoders(encoders)
    image = np.random.default_rng(0).integers(0, 255, (36, 48, 3), dtype=np.uint8)
    decoded, direct = bundle.features(image)
    times = []
    for _ in range(10):
        started = time.time()
        bundle.features(image)
        times.append(time.time() - started)
    cosine = (source(image) * direct).sum(-1)
    norm = np.abs(np.linalg.norm(decoded, axis=-1) - 1).max()
    size = sum((out / name).stat().st_size for name in files) / 1e6
    print(
        f"against the source graphs: least cosine {cosine.min():.5f}; decoded length off by "
        f"{norm:.1e}; {size:.1f} MB; image to decoded features {1e3 * np.median(times):.0f} ms "
        "(median of 10)"
    )
    assert cosine.min() > 0.999 and norm < 1e-3 and size < LARGEST


def arguments_parser():
    arguments = parser("export-tiny", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--text", type=Path, required=True, help="folder written by export-text")
    add("--encoder", type=Path, required=True, help="folder with encoder.onnx and srd.onnx")
    add("--compressor", type=Path, required=True, help="folder written by train-compressor")
    add("--version", default="1", help="(default 1)")
    add("--temperature", type=float, default=10.0, help="of the relevancy's logit (default 10)")
    add("--bias", type=float, default=0.0, help="of the relevancy's logit (default 0)")
    add("--threshold", type=float, default=0.5, help="of the relevancy (default 0.5)")
    add("--present", type=float, default=0.0, help="peak at which a word is present (default 0)")
    add(
        "--steepness",
        type=float,
        default=10.0,
        help="of the logistic from that peak to a confidence (default 10); "
        "`lexsplat evaluate` reports it",
    )
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    files = sources(args)
    for name, folder in files.items():
        if name in ("text.onnx", "tokenizer.json"):
            shutil.copyfile(folder / name, args.out / name)
        else:
            onnx.save(half_precision.stored(onnx.load(folder / name)), args.out / name)
    graphs = [onnx.load(args.encoder / name).graph for name in ("encoder.onnx", "srd.onnx")]
    manifest(args, *graphs).write(args.out, files)
    check(args.out, args.encoder, files)
