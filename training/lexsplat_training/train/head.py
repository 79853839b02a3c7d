"""Train the head of the second image encoder of models/tiny.

The trunk is frozen, so its maps are computed once: at a few points of many samples from labelled
frames and photographs. Then the head learns the text embeddings of the points' words, thousands of
points of different samples at a time. Writes points.npz, which later runs use again, and head.pt.
The seed is fixed.
"""

import time
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F
from tqdm import trange

from ..command_line import parser
from ..constants import MEAN, NEGATIVES, SECOND_SHAPE, STD, STRIDE
from ..export.graphs import export
from ..networks.efficientnet import load_efficientnet
from ..networks.mobilenet import load_mobilenet
from ..networks.second_encoder import Head, surroundings
from ..runtime.session import session
from ..runtime.text_encoder import TextEncoder
from ..samples.words import Words
from .encoder import activation, add_samples, load_sampler
from .loss import Loss, RelevancyLoss

SEED = 3
POINTS = 200  # points of each sample
EXAMPLE = """\
--frames 'rooms/*=0.4' --frames 'house_?=1.5' --photos imagenet-samples --photo-share 0.5 \\
      --backbone mobilenet_v2.tflite --segmenter deeplabv3.tflite --trunk efficientnet-lite2.pth \\
      --text text --vocabulary nouns.json --samples 4000 --out head"""


class Trunk:
    """The frozen trunk, run by ONNX Runtime, as a function from an image to its maps."""

    def __init__(self, path):
        example, names = torch.zeros(1, 3, *SECOND_SHAPE), ["fine", "middle", "deep"]
        trunk = load_efficientnet(path)[0].eval()
        model = export(trunk, (example,), ["image"], names)
        self.session = session(model.SerializeToString())

    def __call__(self, image):
        """image [3, h, w] in 0..255."""
        normalised = ((image[None] - MEAN) / STD).astype(np.float32)
        return [torch.from_numpy(x) for x in self.session.run(None, {"image": normalised})]


def collect(trunk, sampler, count):
    """Points of `count` samples: maps [count, POINTS, C], scenes [count, 1280], words.

    A point is drawn in proportion to its weight in the loss.
    """
    random, rows = np.random.default_rng(SEED), []
    height, width = (side // STRIDE for side in SECOND_SHAPE)
    for _ in trange(count, mininterval=10):
        weight = np.zeros(1)
        while weight.sum() == 0:
            image, word, weight = sampler.draw(SECOND_SHAPE[::-1])
        at = random.choice(weight.size, POINTS, p=weight.ravel() / weight.sum())
        x, y = (at % width + 0.5) / width * 2 - 1, (at // width + 0.5) / height * 2 - 1
        where = torch.from_numpy(np.stack([x, y], -1)).float()[None, None]
        maps = surroundings(*trunk(image))
        there = [F.grid_sample(m, where, padding_mode="border", align_corners=False) for m in maps]
        scene = maps[-1].mean((2, 3))[0]
        rows.append((torch.cat(there, 1)[0, :, 0].T, scene, word.ravel()[at].astype(np.int32)))
    points, scenes, words = zip(*rows, strict=True)
    return torch.stack(points).half().numpy(), torch.stack(scenes).half().numpy(), np.stack(words)


def train(head, loss, points, scenes, words, args):
    """AdamW, rate warmed up over 30 steps and then falling as a cosine."""
    rows, numbers = points.reshape(-1, points.shape[-1]), words.ravel()
    weights = [*head.parameters(), *loss.relevancy.parameters()]
    optimiser = torch.optim.AdamW(weights, lr=args.rate, weight_decay=1e-2)
    random = np.random.default_rng(SEED)
    with trange(args.steps, mininterval=10) as bar:
        for step in bar:
            factor = 0.02 + 0.98 * 0.5 * (1 + np.cos(np.pi * step / args.steps))
            for group in optimiser.param_groups:
                group["lr"] = args.rate * min(step / 30, 1) * factor
            some = random.integers(len(rows), size=args.batch)
            word = torch.from_numpy(numbers[some].astype(np.int64))
            row, scene = (torch.from_numpy(x).float() for x in (rows[some], scenes[some // POINTS]))
            found = head.at_points(row, scene)
            value, cosine, contrast = loss.term(found, word)
            value = value + 0.25 * loss.relevancy(found, word)
            optimiser.zero_grad()
            value.backward()
            nn.utils.clip_grad_norm_(weights, 2.0)
            optimiser.step()
            bar.set_postfix(cosine=f"{cosine:.3f}", contrast=f"{contrast:.3f}")


def arguments_parser():
    arguments = parser("train-head", __doc__, EXAMPLE)
    add = arguments.add_argument
    add_samples(add)
    add("--trunk", type=Path, required=True, help="EfficientNet-Lite2's weights, a .pth file")
    add("--samples", type=int, default=4000, help="samples to take points from (default 4000)")
    add("--steps", type=int, default=1200, help="(default 1200)")
    add("--batch", type=int, default=2048, help="points per step (default 2048)")
    add("--rate", type=float, default=2e-3, help="peak learning rate (default 2e-3)")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def collected(args):
    """The points and the words' names, from points.npz if it is there."""
    file = args.out / "points.npz"
    if not file.exists():
        trunk, classifier = load_mobilenet(args.backbone)
        words = Words(args.vocabulary, args.held_out)
        sampler = load_sampler(args, words, activation(trunk, classifier))
        arrays = collect(Trunk(args.trunk), sampler, args.samples)
        named = dict(zip(("points", "scenes", "words"), arrays, strict=True))
        np.savez(file, names=words.names, **named)
    with np.load(file) as kept:
        return [kept[key] for key in ("points", "scenes", "words")], kept["names"].tolist()


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    torch.manual_seed(SEED)
    torch.set_num_threads(2)
    started = time.time()
    args.out.mkdir(parents=True, exist_ok=True)
    arrays, names = collected(args)
    tower = TextEncoder(args.text, args.out / "texts.npz")
    table, negatives = torch.from_numpy(tower(names)), torch.from_numpy(tower(NEGATIVES))
    head = Head().train()
    loss = Loss(table, RelevancyLoss(table, negatives), torch.Generator().manual_seed(SEED))
    train(head, loss, *arrays, args)
    torch.save({"head": head.state_dict(), "words": names}, args.out / "head.pt")
    print(f"wrote {args.out} after {time.time() - started:.0f} s")
