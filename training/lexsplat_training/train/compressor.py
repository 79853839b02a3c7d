"""Train the generic compressor of models/tiny: features to 32-D codes and back.

Learns from pixel features of labelled frames and from text embeddings of a whole vocabulary, alone
and blended in pairs, so that nouns which no frame shows keep their direction. Every tenth noun is
held out for the report. Writes compress.onnx, decompress.onnx and pixels.npz: the pixel features
and the words of the frames, which later runs use again. The seed is fixed.
"""

import time
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F
from tqdm import trange

from ..command_line import parser
from ..constants import FEATURE_SIZE, NEGATIVES
from ..export.graphs import export_compressor
from ..networks import compressor
from ..networks.vectors import unit
from ..runtime.bundle import Encoders
from ..runtime.text_encoder import TextEncoder
from ..samples import images
from ..samples.frames import read_frames
from ..samples.words import Words

SEED = 21
BATCH = 1024
EXAMPLE = """\
--frames house --frames rooms/r1000 --encoders pair --text text \\
      --vocabulary nouns.json --out compressor"""


def collect(encoders, args, words, per_frame=250):
    """Features of random pixels of all frames and photographs: [n, D]."""
    random, rows = np.random.default_rng(SEED), []

    def take(image):
        features = encoders(image).reshape(-1, FEATURE_SIZE)
        rows.append(torch.from_numpy(features[random.integers(len(features), size=per_frame)]))

    for folder in args.frames:
        for image, _ in read_frames(folder, words, args.skip_box, args.per_folder):
            take(image)
    for path in sorted(args.photos.glob("*.jpg")) if args.photos else []:
        take(images.read(path))
    return torch.cat(rows)


def draw(pixels, texts, frequent, random, size):
    """A batch [size, D] with slight noise: half pixels, then texts, frequent texts, and blends."""

    def some(rows, count):
        return rows[torch.randint(len(rows), (count,), generator=random)]

    blend = torch.rand(size // 4, 1, generator=random)
    parts = [some(pixels, size // 2), some(texts, size // 4), some(frequent, size // 8)]
    first, second = some(texts, size // 4), some(frequent, size // 4)
    batch = torch.cat([*parts, unit(blend * first + (1 - blend) * second, 1)])
    noise = torch.randn(batch.shape, generator=random) * 0.01
    return unit(batch + noise * torch.rand(len(batch), 1, generator=random), 1)


def decoded(networks, rows):
    """Rows [n, D] to codes and back."""
    compress, decompress = networks
    return decompress(compress(rows[:, :, None, None])[:, :, 0, 0])


def train(networks, pixels, texts, frequent, args):
    """Trains with AdamW and a rate that falls as a cosine.

    Loss: 1 - cosine, and the squared error of the cosines to random texts.
    """
    random = torch.Generator().manual_seed(SEED)
    weights = [weight for network in networks for weight in network.parameters()]
    optimiser = torch.optim.AdamW(weights, lr=args.rate, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, args.steps)
    with trange(args.steps, mininterval=10) as bar:
        for _ in bar:
            batch = draw(pixels, texts, frequent, random, BATCH)
            back = decoded(networks, batch)
            cosine = (batch * back).sum(1).mean()
            query = texts[torch.randint(len(texts), (256,), generator=random)]
            query = torch.cat([query, frequent])
            kept = F.mse_loss(back @ query.T, batch @ query.T)
            value = 1 - cosine + 4 * kept
            optimiser.zero_grad()
            value.backward()
            optimiser.step()
            schedule.step()
            bar.set_postfix(cosine=f"{cosine.item():.3f}", kept=f"{kept.item():.4f}")


@torch.inference_mode()
def report(networks, name, rows):
    """Prints the cosine between rows and their reconstruction."""
    cosine = (rows * decoded(networks, rows)).sum(1)
    low = torch.quantile(cosine[:100_000], 0.05).item()
    print(f"{name}: {len(rows)} rows, cosine mean {cosine.mean():.3f}, 5 % quantile {low:.3f}")


def arguments_parser():
    arguments = parser("train-compressor", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--frames", type=Path, action="append", required=True, help="labelled folder (repeatable)")
    add(
        "--skip-box",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="leave out frames taken inside this box (metres)",
    )
    add("--per-folder", type=int, default=40, help="frames used of each folder (default 40)")
    add("--photos", type=Path, help="folder of photographs, for features of things unseen")
    add(
        "--encoders",
        type=Path,
        required=True,
        help="folder with encoder.onnx and srd.onnx, as join-encoders writes them",
    )
    add("--text", type=Path, required=True, help="folder with text.onnx and tokenizer.json")
    add("--vocabulary", type=Path, required=True, help="nouns.json")
    add("--start", type=Path, help="continue from the graphs in this folder")
    add("--steps", type=int, default=4000, help="(default 4000)")
    add("--rate", type=float, default=2e-3, help="first learning rate (default 2e-3)")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    torch.manual_seed(SEED)
    torch.set_num_threads(2)
    started = time.time()
    args.out.mkdir(parents=True, exist_ok=True)
    words = Words()
    file = args.out / "pixels.npz"
    if not file.exists():
        pixels = collect(Encoders(args.encoders), args, words).half().numpy()
        np.savez(file, pixels=pixels, words=words.names)
    with np.load(file) as kept:
        pixels, names = torch.from_numpy(kept["pixels"]).float(), kept["words"].tolist()
    tower = TextEncoder(args.text, args.out / "texts.npz")
    nouns = sorted(Words(args.vocabulary).known)
    held_out = nouns[::10]
    texts = torch.from_numpy(tower([noun for noun in nouns if noun not in set(held_out)]))
    frequent = torch.from_numpy(tower([*names, *NEGATIVES]))
    if args.start:
        networks = compressor.load(args.start)
    else:
        networks = compressor.Compress(), compressor.Decompress()
    train(networks, pixels, texts, frequent, args)
    report(networks, "pixel features", pixels)
    report(networks, "words in the frames", frequent)
    report(networks, "vocabulary", texts)
    report(networks, "vocabulary, held out", torch.from_numpy(tower(held_out)))
    export_compressor(*networks, args.out)
    print(f"wrote {args.out} after {time.time() - started:.0f} s")
