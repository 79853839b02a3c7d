"""A bundle of a plain CLIP vision transformer (OpenAI's or OpenCLIP's) as a dense encoder.

In:  --model, open_clip's name of it (ViT-B-16, ViT-L-14-quickgelu ...); --weights, its file; and for
     the 32-D codes either --compressor, an auto-encoder D -> 32 -> D as published, or --words (lines
     of text, or JSON rows with a "name") and --photos (a folder of JPEG or PNG) to fit one to.
Out: --out, a bundle: vision.onnx (image -> codes), decompress.onnx, text.onnx, tokenizer.json,
     manifest.toml. The server's `--models` takes the folder.

    python export_clip.py --model ViT-B-16 --weights open_clip_model.safetensors \\
        --words nouns.txt --photos photos --size 448 448 --out ../models/vit-b-16

Features are the patches' own values in the last block (MaskCLIP; Zhou et al. 2022), so the grid is as
coarse as the patches: take a large --size and a small patch. What is fitted is linear: the 32 leading
directions of the words' and patches' second moments, both kinds counting the same; codes are unit
length. OpenAI's own .pt files are programs (TorchScript) and are refused: take the same weights as
safetensors or as a state dict.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import nn

import bundle_writer
import clip_towers
import random_weights
import weights
from clip_tokenizer import tokenizer
from published import CODE, AutoEncoder, Compress, Decompress, unit

PHOTOS = 500  # at most, of a folder
PER_PHOTO = 50  # patches


class LinearCompress(nn.Module):
    """[1, D, h, w] -> [1, 32, h, w], along orthonormal directions [32, D]."""

    def __init__(self, directions):
        super().__init__()
        self.layer = nn.Conv2d(directions.shape[1], len(directions), 1, bias=False)
        self.layer.weight = nn.Parameter(directions[:, :, None, None].clone())

    def forward(self, features):
        return unit(self.layer(features), 1)


class LinearDecompress(nn.Module):
    """[n, 32] -> [n, D], along the same directions."""

    def __init__(self, directions):
        super().__init__()
        self.layer = nn.Linear(len(directions), directions.shape[1], bias=False)
        self.layer.weight = nn.Parameter(directions.T.clone())

    def forward(self, codes):
        return unit(self.layer(codes), 1)


def leading_directions(sources):
    """The CODE directions that keep most of unit rows: sources of [n, D] -> [CODE, D].

    Moments about zero and not about the mean: what all rows have in common is kept.
    """
    moments = sum(rows.double().T @ rows.double() / len(rows) for rows in sources)
    _, vectors = torch.linalg.eigh(moments)
    return vectors.T.flip(0)[:CODE].float().contiguous()


def read_words(path):
    """A list of words from lines or from JSON rows."""
    text = Path(path).read_text()
    if Path(path).suffix == ".json":
        words = [row["name"] if isinstance(row, dict) else str(row) for row in json.loads(text)]
    else:
        words = [line.strip() for line in text.splitlines() if line.strip()]
    if len(words) < CODE:
        raise ValueError(f"--words {path}: expected at least {CODE} words, found {len(words)}")
    return words


@torch.inference_mode()
def embed_words(text, words, tokens):
    """[n, D]"""
    return torch.cat([text(torch.tensor([tokens.encode(word).ids])) for word in words])


@torch.inference_mode()
def embed_photos(encoder, folder, size):
    """Some patches of some photographs: [n, D]."""
    files = sorted(path for path in Path(folder).iterdir()
                   if path.suffix.lower() in (".jpg", ".jpeg", ".png"))[:PHOTOS]
    if not files:
        raise ValueError(f"--photos {folder}: expected JPEG or PNG files, found none")
    random, rows = np.random.default_rng(0), []
    mean, std = (torch.tensor(value)[:, None, None] for value in (clip_towers.MEAN,
                                                                  clip_towers.STD))
    for file in files:
        image = Image.open(file).convert("RGB").resize(size[::-1], Image.Resampling.BILINEAR)
        planes = torch.from_numpy(np.array(image)).permute(2, 0, 1).float()
        features = encoder(((planes - mean) / std)[None])[0].flatten(1).T
        rows.append(features[random.integers(len(features), size=PER_PHOTO)])
    return torch.cat(rows)


def fitted(encoder, text, tokens, args):
    """(compress, decompress) fitted to words and photographs."""
    sources = {"words": embed_words(text, read_words(args.words), tokens)}
    if args.photos:
        sources["patches"] = embed_photos(encoder, args.photos, args.size)
    directions = leading_directions(sources.values())
    for name, rows in sources.items():
        kept = unit(rows @ directions.T @ directions, 1)
        print(f"fitted compressor: {len(rows)} {name}, mean cosine to themselves decoded "
              f"{(kept * rows).sum(1).mean():.3f}")
    return LinearCompress(directions), LinearDecompress(directions)


def parser():
    arguments = argparse.ArgumentParser(description=__doc__,
                                        formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--model", required=True, help="open_clip's name, such as ViT-B-16")
    arguments.add_argument("--weights", type=Path, help="both towers' weights")
    arguments.add_argument("--compressor", type=Path, help="weights of an auto-encoder")
    arguments.add_argument("--words", type=Path, help="words to fit a compressor to")
    arguments.add_argument("--photos", type=Path, help="photographs to fit it to as well")
    arguments.add_argument("--size", type=int, nargs=2, default=(448, 448),
                           metavar=("ROWS", "COLUMNS"), help="of the image, multiples of the patch")
    arguments.add_argument("--precision", choices=("fp32", "fp16"), default="fp32")
    arguments.add_argument("--licence", default="as the weight files it was made from")
    arguments.add_argument("--out", type=Path, required=True, help="folder to write")
    arguments.add_argument("--random", type=int, metavar="SEED",
                           help="random weights instead of --weights: to try the machinery")
    return arguments


def main(arguments=None):
    args = parser().parse_args(arguments)
    if args.random is None and args.weights is None:
        parser().error("expected --weights FILE (or --random SEED), found none")
    if (args.compressor is None) == (args.words is None):
        parser().error("expected either --compressor FILE or --words FILE")
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
    bundle = bundle_writer.Bundle(
        name=args.out.name, licence=args.licence, feature=feature, size=args.size,
        grid=encoder.grid, mean=clip_towers.MEAN, std=clip_towers.STD, context=text.context,
        precision=args.precision)
    vision = bundle_writer.Vision(encoder, nn.Identity(), compress).eval()
    bundle_writer.write(args.out, bundle, vision, decompress.eval(), text, tokens)
    size = sum((args.out / name).stat().st_size for name in bundle.files) / 1e6
    print(f"wrote {args.out}: {size:.0f} MB, in {time.time() - started:.0f} s")


if __name__ == "__main__":
    try:
        main()
    except (weights.WeightsError, ValueError) as error:
        sys.exit(f"error: {error}")
