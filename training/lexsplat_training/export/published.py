"""Export the paper's networks as a bundle, from the published weight files.

--image: the fine-tuned image tower (SED's sed_model_large.pth, or any file with the tensors of
  open_clip's convnext_large_d_320, with or without a prefix)
--text: open_clip's weights, for the text tower; by default --image
--srd: the super-resolution decoder (high_res_71_indoor.ckpt)
--compressor: the auto-encoder D -> 32 -> D (ae_149_he.ckpt)

Writes vision.onnx (image -> codes), decompress.onnx, text.onnx, tokenizer.json and manifest.toml.
The server's --models takes the folder. No code in a weight file is run; files that were saved as
whole Python objects, such as seg_clip_model_l.pth, are refused. It is not documented whether the
released networks were trained on RGB or BGR: try --channel-order bgr if answers are poor.
"""

import time
from pathlib import Path

import torch

from ..command_line import InputError, parser
from ..networks import clip_towers, random_weights, weights
from ..networks.clip_tokenizer import tokenizer
from ..networks.published import AutoEncoder, Compress, Decompress, SuperResolution
from . import bundle_writer
from .bundle import Bundle

EXAMPLE = """\
--image sed_model_large.pth --text open_clip_model.safetensors \\
      --srd high_res_71_indoor.ckpt --compressor ae_149_he.ckpt --out ../models/published"""
MODEL = "convnext_large_d_320"
STRIDES = (32, 4)  # of the tower's output, and of the codes
LICENCE = "as the weight files it was made from"


def networks(args):
    """(Vision, decoder, text tower, feature size), with the files' or random weights."""
    clip = clip_towers.build(args.model)
    head = getattr(clip.visual, "head", None)
    if not hasattr(head, "mlp"):
        raise InputError(f"--model: expected ConvNeXt with an MLP as head, such as {MODEL}")
    feature = head.mlp.fc2.out_features
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


def arguments_parser():
    arguments = parser("export-published", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--image", type=Path, help="weights of the image tower")
    add("--text", type=Path, help="weights of the text tower (default: those of --image)")
    add("--srd", type=Path, help="weights of the super-resolution decoder")
    add("--compressor", type=Path, help="weights of the auto-encoder")
    add("--out", type=Path, required=True, help="folder to write to")
    add("--model", default=MODEL, help=f"open_clip's name of the towers (default {MODEL})")
    add(
        "--size",
        type=int,
        nargs=2,
        default=(768, 768),
        metavar=("ROWS", "COLUMNS"),
        help="of the image, multiples of 32 (default 768 768)",
    )
    add("--precision", choices=("fp32", "fp16"), default="fp32", help="fp16 is for GPUs")
    add("--unfolded", action="store_true", help="write three graphs instead of one")
    add("--channel-order", choices=("rgb", "bgr"), default="rgb", help="of the image (default rgb)")
    add("--licence", default=LICENCE, help=f"for the manifest (default {LICENCE!r})")
    add("--random", type=int, metavar="SEED", help="random weights instead of files, for a trial")
    return arguments


def main(arguments=None):
    reader = arguments_parser()
    args = reader.parse_args(arguments)
    missing = [name for name in ("image", "srd", "compressor") if getattr(args, name) is None]
    if args.random is None and missing:
        reader.error(f"expected --{missing[0]} FILE (or --random SEED), found none")
    coarse, fine = STRIDES
    if any(side < coarse or side % coarse for side in args.size):
        reader.error(f"--size: expected multiples of {coarse}, found {args.size}")
    torch.manual_seed(args.random or 0)
    started = time.time()
    vision, decoder, text, feature = networks(args)
    bundle = Bundle(
        name=args.out.name,
        licence=args.licence,
        feature=feature,
        size=tuple(args.size),
        grid=tuple(side // fine for side in args.size),
        mean=clip_towers.MEAN,
        std=clip_towers.STD,
        context=text.context,
        channel_order=args.channel_order,
        precision=args.precision,
        folded=not args.unfolded,
    )
    bundle_writer.write(args.out, bundle, vision, decoder, text, tokenizer(text.context))
    size = sum((args.out / name).stat().st_size for name in bundle.files) / 1e6
    print(f"wrote {args.out}: {size:.0f} MB, in {time.time() - started:.0f} s")
