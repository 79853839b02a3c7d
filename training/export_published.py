"""A bundle of the published networks, from the weight files that you have.

In:  --image       the fine-tuned image tower (SED's sed_model_large.pth, or any file with the tensors
                   of open_clip's convnext_large_d_320 below some prefix)
     --text        open_clip's weights, for the text tower; absent: --image has it as well
     --srd         the super-resolution decoder (high_res_71_indoor.ckpt)
     --compressor  the auto-encoder D -> 32 -> D (ae_149_he.ckpt)
Out: --out, a bundle: vision.onnx (image -> codes, everything folded), decompress.onnx, text.onnx,
     tokenizer.json, manifest.toml. The server's `--models` takes the folder.

    python export_published.py --image sed_model_large.pth --text open_clip_model.safetensors \\
        --srd high_res_71_indoor.ckpt --compressor ae_149_he.ckpt --out ../models/published

Nothing in a weight file is run. A file that was saved as a whole Python object, such as
seg_clip_model_l.pth, is refused with what to do. Whether the released SRD and auto-encoder were
trained on RGB or BGR is not documented: try --channel-order.
"""

import argparse
import sys
import time
from pathlib import Path

import torch

import bundle_writer
import clip_towers
import random_weights
import weights
from clip_tokenizer import tokenizer
from published import AutoEncoder, Compress, Decompress, SuperResolution

MODEL = "convnext_large_d_320"
STRIDES = (32, 4)  # of the tower's output, and of the codes
LICENCE = "as the weight files it was made from"


def networks(args):
    """(Vision, decoder, text tower): random, or with the files' weights."""
    clip = clip_towers.build(args.model)
    feature = clip.visual.head.mlp.fc2.out_features
    encoder = clip_towers.ConvNextDense(clip.visual)
    text = clip_towers.TextTower(clip)
    srd = SuperResolution(feature, encoder.skips)
    auto_encoder = AutoEncoder(feature)
    if args.random is None:
        image = weights.read(args.image)
        weights.fit(clip.visual, image, args.image, "image tower")
        if args.text and args.text != args.image:
            image = weights.read(args.text)
        weights.fit(text, image, args.text or args.image, "text tower")
        del image
        weights.load(srd, args.srd, "super-resolution decoder")
        weights.load(auto_encoder, args.compressor, "auto-encoder")
    else:
        for module in (clip, srd, auto_encoder):
            random_weights.scattered(module, args.random)
        random_weights.calibrated(encoder, srd, auto_encoder, seed=args.random)
    vision = bundle_writer.Vision(encoder, srd, Compress(auto_encoder))
    return vision.eval(), Decompress(auto_encoder).eval(), text.eval(), feature


def parser():
    arguments = argparse.ArgumentParser(description=__doc__,
                                        formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--image", type=Path, help="weights of the image tower")
    arguments.add_argument("--text", type=Path, help="weights of the text tower")
    arguments.add_argument("--srd", type=Path, help="weights of the super-resolution decoder")
    arguments.add_argument("--compressor", type=Path, help="weights of the auto-encoder")
    arguments.add_argument("--out", type=Path, required=True, help="folder to write")
    arguments.add_argument("--model", default=MODEL, help=f"open_clip's name (default {MODEL})")
    arguments.add_argument("--size", type=int, nargs=2, default=(768, 768),
                           metavar=("ROWS", "COLUMNS"), help="of the image, multiples of 32")
    arguments.add_argument("--precision", choices=("fp32", "fp16"), default="fp32",
                           help="fp16 is for GPUs; inputs and outputs stay fp32")
    arguments.add_argument("--unfolded", action="store_true", help="three graphs instead of one")
    arguments.add_argument("--channel-order", choices=("rgb", "bgr"), default="rgb")
    arguments.add_argument("--licence", default=LICENCE, help="what the manifest says of it")
    arguments.add_argument("--random", type=int, metavar="SEED",
                           help="random weights instead of files: to try the machinery")
    return arguments


def main(arguments=None):
    args = parser().parse_args(arguments)
    missing = [name for name in ("image", "srd", "compressor") if getattr(args, name) is None]
    if args.random is None and missing:
        parser().error(f"expected --{missing[0]} FILE (or --random SEED), found none")
    coarse, fine = STRIDES
    if any(side < coarse or side % coarse for side in args.size):
        parser().error(f"--size: expected multiples of {coarse}, found {args.size}")
    torch.manual_seed(args.random or 0)
    started = time.time()
    vision, decoder, text, feature = networks(args)
    bundle = bundle_writer.Bundle(
        name=args.out.name, licence=args.licence, feature=feature, size=tuple(args.size),
        grid=tuple(side // fine for side in args.size), mean=clip_towers.MEAN, std=clip_towers.STD,
        context=text.context, channel_order=args.channel_order, precision=args.precision,
        folded=not args.unfolded)
    bundle_writer.write(args.out, bundle, vision, decoder, text, tokenizer(text.context))
    size = sum((args.out / name).stat().st_size for name in bundle.files) / 1e6
    print(f"wrote {args.out}: {size:.0f} MB, in {time.time() - started:.0f} s")


if __name__ == "__main__":
    try:
        main()
    except (weights.WeightsError, ValueError) as error:
        sys.exit(f"error: {error}")
