"""Export a CLIP vision transformer (OpenAI's or OpenCLIP's) as a bundle with dense features.

--model: open_clip's name, such as ViT-B-16; --weights: its file (safetensors or a state dict).
Codes come from --compressor, an auto-encoder D -> 32 -> D as published, or from a linear compressor
that is fitted to --words and optionally --photos.

Features are the patches' own values in the last block (MaskCLIP; Zhou et al. 2022), so the grid is
as coarse as the patches: take a large --size and a model with small patches. Writes vision.onnx
(image -> codes), decompress.onnx, text.onnx, tokenizer.json and manifest.toml. OpenAI's own .pt
files contain programs (TorchScript) and are refused: take the same weights as safetensors.
"""

import json
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import nn

from ..command_line import InputError, parser
from ..constants import CODE_SIZE
from ..networks import clip_towers, linear_compressor, random_weights, weights
from ..networks.clip_tokenizer import tokenizer
from ..networks.published import AutoEncoder, Compress, Decompress
from ..networks.vectors import unit
from . import bundle_writer
from .bundle import Bundle

EXAMPLE = """\
--model ViT-B-16 --weights open_clip_model.safetensors --words nouns.txt \\
      --photos photos --size 448 448 --out ../models/vit-b-16"""
PHOTOS = 500  # largest number of photographs used
PER_PHOTO = 50  # patches used of each
LICENCE = "as the weight files it was made from"


def read_words(path):
    """The words of a file: lines, or for .json a list of strings or of rows with "name"."""
    text = Path(path).read_text()
    if Path(path).suffix == ".json":
        words = [row["name"] if isinstance(row, dict) else str(row) for row in json.loads(text)]
    else:
        words = [line.strip() for line in text.splitlines() if line.strip()]
    if len(words) < CODE_SIZE:
        raise InputError(f"--words {path}: expected at least {CODE_SIZE} words, found {len(words)}")
    return words


@torch.inference_mode()
def embed_words(text, words, tokens):
    """Embeddings of words: [n, D]."""
    return torch.cat([text(torch.tensor([tokens.encode(word).ids])) for word in words])


@torch.inference_mode()
def embed_photos(encoder, folder, size):
    """Features of random patches of up to PHOTOS photographs: [n, D]."""
    files = sorted(
        path for path in Path(folder).iterdir() if path.suffix.lower() in (".jpg", ".jpeg", ".png")
    )[:PHOTOS]
    if not files:
        raise InputError(f"--photos {folder}: expected JPEG or PNG files, found none")
    random, rows = np.random.default_rng(0), []
    moments = clip_towers.MEAN, clip_towers.STD
    mean, std = (torch.tensor(value)[:, None, None] for value in moments)
    for file in files:
        image = Image.open(file).convert("RGB").resize(size[::-1], Image.Resampling.BILINEAR)
        planes = torch.from_numpy(np.array(image)).permute(2, 0, 1).float()
        features = encoder(((planes - mean) / std)[None])[0].flatten(1).T
        rows.append(features[random.integers(len(features), size=PER_PHOTO)])
    return torch.cat(rows)


def fitted(encoder, text, tokens, args):
    """(compress, decompress), fitted to words and photographs."""
    sources = {"words": embed_words(text, read_words(args.words), tokens)}
    if args.photos:
        sources["patches"] = embed_photos(encoder, args.photos, args.size)
    directions = linear_compressor.leading_directions(sources.values())
    for name, rows in sources.items():
        kept = unit(rows @ directions.T @ directions, 1)
        print(
            f"fitted compressor: {len(rows)} {name}, mean cosine to themselves decoded "
            f"{(kept * rows).sum(1).mean():.3f}"
        )
    return linear_compressor.Compress(directions), linear_compressor.Decompress(directions)


def arguments_parser():
    arguments = parser("export-clip", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--model", required=True, help="open_clip's name, such as ViT-B-16")
    add("--weights", type=Path, help="weights of both towers")
    add("--compressor", type=Path, help="weights of an auto-encoder")
    add("--words", type=Path, help="words to fit a compressor to (.txt or .json)")
    add("--photos", type=Path, help="folder of photographs to fit it to as well")
    add(
        "--size",
        type=int,
        nargs=2,
        default=(448, 448),
        metavar=("ROWS", "COLUMNS"),
        help="of the image, multiples of the patch (default 448 448)",
    )
    add("--precision", choices=("fp32", "fp16"), default="fp32", help="fp16 is for GPUs")
    add("--licence", default=LICENCE, help=f"for the manifest (default {LICENCE!r})")
    add("--out", type=Path, required=True, help="folder to write to")
    add("--random", type=int, metavar="SEED", help="random weights instead of files, for a trial")
    return arguments


def main(arguments=None):
    reader = arguments_parser()
    args = reader.parse_args(arguments)
    if args.random is None and args.weights is None:
        reader.error("expected --weights FILE (or --random SEED), found none")
    if (args.compressor is None) == (args.words is None):
        reader.error("expected either --compressor FILE or --words FILE")
    torch.manual_seed(args.random or 0)
    started = time.time()
    args.size = tuple(args.size)
    clip = clip_towers.build(args.model)
    if args.random is None:
        weights.load(clip, args.weights, "towers")
    else:
        random_weights.scattered(clip, args.random)
    encoder = clip_towers.VitDense(clip.visual, *args.size).eval()
    text = clip_towers.TextTower(clip).eval()
    tokens, feature = tokenizer(text.context), clip.visual.proj.shape[1]
    if args.compressor:
        auto_encoder = weights.load(AutoEncoder(feature), args.compressor, "auto-encoder")
        compress, decompress = Compress(auto_encoder), Decompress(auto_encoder)
    else:
        compress, decompress = fitted(encoder, text, tokens, args)
    bundle = Bundle(
        name=args.out.name,
        licence=args.licence,
        feature=feature,
        size=args.size,
        grid=encoder.grid,
        mean=clip_towers.MEAN,
        std=clip_towers.STD,
        context=text.context,
        precision=args.precision,
    )
    vision = bundle_writer.Vision(encoder, nn.Identity(), compress).eval()
    bundle_writer.write(args.out, bundle, vision, decompress.eval(), text, tokens)
    size = sum((args.out / name).stat().st_size for name in bundle.files) / 1e6
    print(f"wrote {args.out}: {size:.0f} MB, in {time.time() - started:.0f} s")
