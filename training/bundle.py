"""Assemble a bundle: ONNX files, manifest with checksums, and a parity check against torch.

In:  the folders written by text.py, encoder.py and compressor.py.
Out: a folder with encoder.onnx, srd.onnx, compress.onnx, decompress.onnx, text.onnx,
     tokenizer.json and manifest.toml. Large weights of the image networks are stored as fp16 and
     cast to fp32 when the session loads; all inputs and outputs are fp32.
"""

import argparse
import hashlib
import shutil
import time
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper

import encoder as networks
from compressor import CODE
from data import STRIDE
from evaluate import Bundle
from text import INPUTS, MAX_TOKENS

FILES = ["encoder.onnx", "srd.onnx", "compress.onnx", "decompress.onnx", "text.onnx",
         "tokenizer.json"]
MANIFEST = """\
name = "{name}"
version = "{version}"
licence = "Apache-2.0"
feature_size = {feature}
code_size = {code}

[image]
width = {width}
height = {height}
fit = "squash"
channel_order = "rgb"
mean = [{mean}, {mean}, {mean}]
std = [{std}, {std}, {std}]

[encoder]
file = "encoder.onnx"
input = "image"
outputs = ["coarse", "skip8", "skip4"]

[srd]
file = "srd.onnx"
inputs = ["coarse", "skip8", "skip4"]
output = "features"
grid = [{rows}, {columns}]

[compressor]
encoder = {{ file = "compress.onnx", input = "features", output = "codes" }}
decoder = {{ file = "decompress.onnx", input = "codes", output = "features" }}

[text]
file = "text.onnx"
tokenizer = "tokenizer.json"
inputs = {inputs}
output = "embedding"
max_tokens = {tokens}

[relevancy]
temperature = {temperature}
bias = {bias}
threshold = {threshold}
negatives = {negatives}
present_threshold = {present}
confidence_steepness = {steepness}

[sha256]
{checksums}
"""


def quoted(names):
    """A TOML list of strings."""
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


def halve(source, target):
    """Copy a graph with weights of more than 1,000 values stored as fp16 behind a Cast."""
    model = onnx.load(source)
    graph, casts = model.graph, []
    for weight in list(graph.initializer):
        if weight.data_type == TensorProto.FLOAT and np.prod(weight.dims) > 1000:
            half = numpy_helper.to_array(weight).astype(np.float16)
            graph.initializer.remove(weight)
            graph.initializer.append(numpy_helper.from_array(half, weight.name + ".half"))
            casts.append(helper.make_node("Cast", [weight.name + ".half"], [weight.name],
                                          to=TensorProto.FLOAT))
    nodes = casts + list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    onnx.save(model, target)


def write_manifest(out, args):
    """manifest.toml, with the SHA-256 of every file."""
    height, width = networks.SHAPE
    checksums = "\n".join(
        f'"{name}" = "{hashlib.sha256((out / name).read_bytes()).hexdigest()}"' for name in FILES)
    (out / "manifest.toml").write_text(MANIFEST.format(
        name=out.name, version=args.version, feature=networks.FEATURE, code=CODE, width=width,
        height=height, mean=networks.MEAN, std=networks.STD, rows=height // STRIDE,
        columns=width // STRIDE, inputs=quoted(INPUTS), tokens=MAX_TOKENS,
        temperature=args.temperature, bias=args.bias,
        threshold=args.threshold, negatives=quoted(networks.NEGATIVES),
        present=args.present, steepness=args.steepness,
        checksums=checksums))


@torch.inference_mode()
def check(out, weights):
    """The bundle's features against torch on a random image, and the time a frame takes."""
    bundle = Bundle(out)
    image = np.random.default_rng(0).integers(0, 255, (36, 48, 3), dtype=np.uint8)
    encoder, srd = networks.load(weights)
    wanted = srd(*encoder(torch.from_numpy(bundle.tensor(image))))[0].permute(1, 2, 0).numpy()
    decoded, direct = bundle.features(image)
    times = []
    for _ in range(10):
        started = time.time()
        bundle.features(image)
        times.append(time.time() - started)
    cosine = (wanted * direct).sum(-1)
    norm = np.abs(np.linalg.norm(decoded, axis=-1) - 1).max()
    size = sum((out / name).stat().st_size for name in FILES) / 1e6
    print(f"ONNX against torch: least cosine {cosine.min():.5f}; decoded length off by {norm:.1e}; "
          f"{size:.1f} MB; image to decoded features {1e3 * np.median(times):.0f} ms (median of 10)")
    assert cosine.min() > 0.999 and norm < 1e-3 and size < 40


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--text", type=Path, required=True, help="folder written by text.py")
    parser.add_argument("--encoder", type=Path, required=True, help="folder written by encoder.py")
    parser.add_argument("--compressor", type=Path, required=True, help="written by compressor.py")
    parser.add_argument("--version", default="1")
    parser.add_argument("--temperature", type=float, default=10.0)
    parser.add_argument("--bias", type=float, default=0.0, help="of the relevancy's logit")
    parser.add_argument("--threshold", type=float, default=0.5)
    parser.add_argument("--present", type=float, default=0.0, help="peak that means 'present'")
    parser.add_argument("--steepness", type=float, default=10.0,
                        help="of the logistic from that peak to a confidence (evaluate's report has it)")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        folder = {"e": args.encoder, "s": args.encoder, "t": args.text}.get(name[0])
        if name.endswith(".onnx") and not name.startswith("text"):
            halve((folder or args.compressor) / name, args.out / name)
        else:
            shutil.copyfile(args.text / name, args.out / name)
    write_manifest(args.out, args)
    check(args.out, args.encoder / "encoder.pt")


if __name__ == "__main__":
    main()
