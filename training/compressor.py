"""Generic compressor: D language features to 32-D codes and back, two small MLPs.

In:  encoder.pt (from encoder.py), labelled frames, the text tower and a vocabulary; with --start
     the graphs of an earlier run to go on from.
Out: compress.onnx (features [1, D, h, w] -> codes [1, 32, h, w]) and decompress.onnx
     (codes [n, 32] -> features [n, D]); all outputs have unit length.

Paper section 4.2, first stage. Trained on pixel features of the frames AND on text embeddings of
the whole vocabulary (alone, and blended two by two), so that nouns no frame shows keep their
direction. Loss: 1 - cos + L2, and the cosines among a batch of words are kept.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn
from torch.nn import functional as F
from tqdm import trange

import data
import encoder as networks
from text import TextEncoder

SEED = 21
CODE = 32


def unit(x, axis):
    """Unit length along an axis."""
    return x / x.square().sum(axis, keepdim=True).clamp_min(1e-12).sqrt()


class Compress(nn.Module):
    """[n, D, h, w] -> [n, 32, h, w]; 1x1 convolutions, so that a map needs no reshaping."""

    def __init__(self, feature=networks.FEATURE, width=192):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(feature, width, 1), nn.ReLU(), nn.Conv2d(width, 96, 1), nn.ReLU(),
            nn.Conv2d(96, CODE, 1))
        self.straight = nn.Conv2d(feature, CODE, 1)

    def forward(self, features):
        return unit(self.straight(features) + self.layers(features), 1)


class Decompress(nn.Module):
    """[n, 32] -> [n, D]."""

    def __init__(self, feature=networks.FEATURE):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(CODE, 192), nn.ReLU(), nn.Linear(192, 320), nn.ReLU(),
            nn.Linear(320, feature))
        self.straight = nn.Linear(CODE, feature)

    def forward(self, codes):
        return unit(self.straight(codes) + self.layers(codes), 1)


def resume(compress, decompress, folder):
    """Weights from the graphs of an earlier run: their tensors bear our names."""
    for network, name in ((compress, "compress.onnx"), (decompress, "decompress.onnx")):
        stored = {w.name: numpy_helper.to_array(w)
                  for w in onnx.load(folder / name).graph.initializer}
        network.load_state_dict({key: torch.from_numpy(stored[key].copy())
                                 for key in network.state_dict()})


@torch.inference_mode()
def collect(encoder, srd, args, words, per_frame=250):
    """Pixel features of all frames: [n, D]."""
    random, rows = np.random.default_rng(SEED), []
    for folder in args.frames:
        for image, _ in data.read_frames(folder, words, args.skip_box, args.per_folder):
            height, width = networks.SHAPE
            image = data.resize(image, width, height, data.Image.Resampling.BILINEAR)
            x = torch.from_numpy(image.copy()).permute(2, 0, 1)[None].float()
            features = srd(*encoder((x - networks.MEAN) / networks.STD))[0].flatten(1)
            rows.append(features[:, random.integers(features.shape[1], size=per_frame)].T)
    return torch.cat(rows)


def draw(pixels, texts, frequent, random, size):
    """A batch: pixel features, words, frequent words, blends of two words; slightly noisy."""
    def some(rows, count):
        return rows[torch.randint(len(rows), (count,), generator=random)]

    blend = torch.rand(size // 4, 1, generator=random)
    batch = torch.cat([
        some(pixels, size // 2), some(texts, size // 4), some(frequent, size // 8),
        unit(blend * some(texts, size // 4) + (1 - blend) * some(frequent, size // 4), 1)])
    noise = torch.randn(batch.shape, generator=random) * 0.01
    return unit(batch + noise * torch.rand(len(batch), 1, generator=random), 1)


def train(compress, decompress, pixels, texts, frequent, args):
    """Adam with a cosine rate on random batches."""
    random = torch.Generator().manual_seed(SEED)
    both = [*compress.parameters(), *decompress.parameters()]
    optimiser = torch.optim.AdamW(both, lr=args.rate, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, args.steps)
    with trange(args.steps, mininterval=10) as bar:
        for _ in bar:
            batch = draw(pixels, texts, frequent, random, 1024)
            back = decompress(compress(batch[:, :, None, None])[:, :, 0, 0])
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


def export(compress, decompress, folder):
    """Both graphs; the number of codes to decode is dynamic."""
    height, width = (side // data.STRIDE for side in networks.SHAPE)
    example = torch.zeros(1, networks.FEATURE, height, width)
    torch.onnx.export(compress, (example,), str(folder / "compress.onnx"), opset_version=17,
                      input_names=["features"], output_names=["codes"], dynamo=False)
    torch.onnx.export(decompress, (torch.zeros(2, CODE),), str(folder / "decompress.onnx"),
                      input_names=["codes"], output_names=["features"], opset_version=17,
                      dynamic_axes={"codes": {0: "n"}, "features": {0: "n"}}, dynamo=False)


@torch.inference_mode()
def report(compress, decompress, name, rows):
    """Cosine between features and their reconstruction."""
    back = decompress(compress(rows[:, :, None, None])[:, :, 0, 0])
    cosine = (rows * back).sum(1)
    low = torch.quantile(cosine[:100_000], 0.05).item()
    print(f"{name}: {len(rows)} rows, cosine mean {cosine.mean():.3f}, 5 % quantile {low:.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=Path, action="append", required=True)
    parser.add_argument("--skip-box", type=float, nargs=4, metavar=("X0", "Y0", "X1", "Y1"))
    parser.add_argument("--per-folder", type=int, default=40, help="frames used of each folder")
    parser.add_argument("--encoder", type=Path, required=True, help="encoder.pt")
    parser.add_argument("--text", type=Path, required=True, help="folder with text.onnx")
    parser.add_argument("--vocabulary", type=Path, required=True, help="nouns.json")
    parser.add_argument("--start", type=Path, help="folder of an earlier run to go on from")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    torch.manual_seed(SEED)
    torch.set_num_threads(2)
    started = time.time()
    args.out.mkdir(parents=True, exist_ok=True)
    words = data.Words()
    pixels = collect(*networks.load(args.encoder), args, words)
    tower = TextEncoder(args.text, args.out / "texts.npz")
    nouns = sorted(data.Words(args.vocabulary).known)
    held_out = nouns[::10]
    texts = torch.from_numpy(tower([noun for noun in nouns if noun not in set(held_out)]))
    frequent = torch.from_numpy(tower([*words.names, "object", "things", "stuff", "texture"]))
    compress, decompress = Compress(), Decompress()
    if args.start:
        resume(compress, decompress, args.start)
    train(compress, decompress, pixels, texts, frequent, args)
    report(compress, decompress, "pixel features", pixels)
    report(compress, decompress, "words in the frames", frequent)
    report(compress, decompress, "vocabulary", texts)
    report(compress, decompress, "vocabulary, held out", torch.from_numpy(tower(held_out)))
    export(compress.eval(), decompress.eval(), args.out)
    print(f"wrote {args.out} after {time.time() - started:.0f} s")


if __name__ == "__main__":
    main()
