"""Image encoder and super-resolution decoder (SRD): pixels to a unit language feature per pixel.

In:  labelled frames (--frames GLOB or GLOB=WEIGHT, repeatable), photographs (--photos) and a
     segmentation network for them (--segmenter), the MobileNetV2 TFLite file (--backbone), the
     folder of the text tower (--text), a vocabulary for synonyms.
Out: encoder.pt (weights of both networks), and with --export encoder.onnx and srd.onnx.

Paper section 4.1: a coarse language map and two skip levels from the encoder; the SRD
doubles the resolution twice, each time fusing a skip through an attention gate. Loss
0.8 (1 - cos) + L1 + 0.01 TV against the text embedding of each pixel's word, and two terms that
the paper does not have: one tells the word from all other words of the training set, one fits the
relevancy itself (`Asked`).
"""

import argparse
import glob
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F
from tqdm import tqdm

import data
from mobilenet import Convolution, MobileNet, load_mobilenet
from text import TextEncoder

SEED = 20
FEATURE = 384
MEAN, STD = 127.5, 127.5
SHAPE = (288, 384)
NEGATIVES = ["object", "things", "stuff", "texture"]


def unit(x):
    """Unit length over channels."""
    return x / x.square().sum(1, keepdim=True).clamp_min(1e-12).sqrt()


def double(x):
    """Twice the resolution."""
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def conv(inputs, outputs, size=1, groups=1):
    """Convolution, batch norm, ReLU."""
    return nn.Sequential(
        Convolution(inputs, outputs, size, padding=size // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs), nn.ReLU(),
    )


def rows_at(maps, image, y, x):
    """The channels of some pixels: [n, C] from [b, C, h, w]."""
    _, channels, height, width = maps.shape
    flat = maps.permute(0, 2, 3, 1).reshape(-1, channels)
    return flat.index_select(0, (image * height + y) * width + x)


class Encoder(nn.Module):
    """Image (normalised) -> coarse [384, h/16, w/16], skip8 [32, h/8, w/8], skip4 [24, h/4, w/4]."""

    def __init__(self, width=256):
        super().__init__()
        self.trunk = MobileNet()
        self.deep, self.middle = conv(1280, width), conv(96, width)
        self.mix = nn.Sequential(conv(width, width, 3, groups=width), conv(width, width))
        self.scene = nn.Linear(1280, width)
        self.project = Convolution(width, FEATURE, 1)

    def forward(self, image):
        with torch.no_grad():  # these blocks stay as ImageNet made them
            skip4, skip8 = self.trunk.early(image)
        middle, deep = self.trunk.late(skip8)
        scene = self.scene(deep.mean((2, 3)))[:, :, None, None]
        x = double(self.deep(deep)) + self.middle(middle) + scene
        return self.project(x + self.mix(x)), skip8, skip4


class Fusion(nn.Module):
    """Concatenate a skip, convolve, and gate the result by its own attention."""

    def __init__(self, width, skip, groups):
        super().__init__()
        self.join = conv(width + skip, width)
        self.spread = conv(width, width, 3, groups=groups)
        self.gate = nn.Sequential(conv(width, width // 4), Convolution(width // 4, width, 1))

    def forward(self, high, low):
        joined = self.join(torch.cat([high, low], 1))
        mixed = joined + self.spread(joined)
        return mixed + mixed * self.gate(mixed).sigmoid()


class Srd(nn.Module):
    """coarse, skip8, skip4 -> features [384, h/4, w/4] of unit length."""

    def __init__(self, width=128):
        super().__init__()
        self.enter = conv(FEATURE, width)
        self.fuse8, self.fuse4 = Fusion(width, 32, width // 32), Fusion(width, 24, width)
        self.last = conv(width, width, 3, groups=width)
        self.leave = Convolution(width, FEATURE, 1)

    def hidden(self, coarse, skip8, skip4):
        """The last map before the projection to D channels."""
        x = self.fuse8(double(self.enter(coarse)), skip8)
        x = self.fuse4(double(x), skip4)
        return x + self.last(x)

    def forward(self, coarse, skip8, skip4):
        return unit(self.leave(self.hidden(coarse, skip8, skip4)))

    def at(self, hidden, image, y, x):
        """Unit features [n, D] at some pixels only: the whole map is costly in training."""
        rows = rows_at(hidden, image, y, x)
        return unit(F.linear(rows, self.leave.weight[:, :, 0, 0], self.leave.bias))


class Asked(nn.Module):
    """What the map will be asked: is this pixel the word? Cross-entropy of the relevancy itself.

    logit = scale (f.q - max f.n) - offset, n the bundle's negatives; scale and offset are learned.
    Words whose embedding lies within `near` of the pixel's own are neither right nor wrong.
    """

    def __init__(self, table, negatives, near=0.62, others=96):
        super().__init__()
        self.table, self.negatives, self.others = table, negatives, others
        self.alike = table @ table.T > near
        self.scale = nn.Parameter(torch.tensor(9.0))
        self.offset = nn.Parameter(torch.tensor(4.0))

    def forward(self, found, word):
        present = word.unique()
        count = min(self.others, len(self.table))
        asked = torch.cat([present, torch.randperm(len(self.table))[:count]]).unique()
        against = (found @ self.negatives.T).max(1, keepdim=True).values
        logit = self.scale * (found @ self.table[asked].T - against) - self.offset
        right = word[:, None] == asked
        wrong = ~self.alike[word][:, asked]
        hits = F.softplus(-logit[right]).mean()
        misses = F.softplus(logit) * wrong
        # absent words are many and easy: those in the batch count as much as all the others
        inside = torch.isin(asked, present)
        return hits + misses[:, inside].sum(1).mean() + misses[:, ~inside].mean() * 20


class Loss:
    """The paper's loss, the contrastive and the asked term, on some of the labelled pixels."""

    def __init__(self, table, asked, random, samples=3000, temperature=0.06):
        self.table, self.asked, self.random = table, asked, random
        self.samples, self.temperature = samples, temperature

    def pixels(self, weight):
        """(image, y, x) of pixels drawn in proportion to their weight."""
        count = min(self.samples, int((weight > 0).sum()))
        flat = torch.multinomial(weight.flatten(), count, generator=self.random)
        _, height, width = weight.shape
        return flat // (height * width), flat // width % height, flat % width

    def term(self, found, word, contrast_weight=0.25):
        """0.8 (1 - cos) + L1 + contrast against all words; and (cosine, contrast) to show."""
        wanted = self.table[word]
        cosine = (found * wanted).sum(1).mean()
        logits = found @ self.table.T / self.temperature
        alike = self.asked.alike[word].scatter(1, word[:, None], False)
        contrast = F.cross_entropy(logits.masked_fill(alike, -1e4), word)
        value = 0.8 * (1 - cosine) + (found - wanted).abs().mean() + contrast_weight * contrast
        return value, cosine.item(), contrast.item()

    def __call__(self, srd, maps, word, weight):
        image, y, x = self.pixels(weight)
        word = word[image, y, x]
        hidden = srd.hidden(*maps)
        found = srd.at(hidden, image, y, x)
        value, *shown = self.term(found, word)
        few = slice(0, self.samples // 4)
        right = srd.at(hidden, image[few], y[few], (x[few] + 1).clamp_max(hidden.shape[3] - 1))
        below = srd.at(hidden, image[few], (y[few] + 1).clamp_max(hidden.shape[2] - 1), x[few])
        variation = (right - found[few]).abs().mean() + (below - found[few]).abs().mean()
        rough = unit(rows_at(maps[0], image, y // 4, x // 4))
        asked = self.asked(found, word)
        value = value + 0.01 * variation + 0.3 * self.term(rough, word)[0] + 0.25 * asked
        return value, *shown, asked.item()


def activation(trunk, classifier):
    """Class activation maps of the original classifier: where a photograph shows its class."""
    weight, _ = classifier
    trunk = trunk.eval().to(memory_format=torch.channels_last)

    @torch.inference_mode()
    def heat(image, index):
        x = torch.from_numpy(data.resize(image, 256, 256, data.Image.Resampling.BILINEAR).copy())
        x = (x.permute(2, 0, 1)[None].float() - MEAN) / STD
        logits = torch.einsum("chw,c->hw", trunk(x)[3][0], weight[index + 1])
        low, high = logits.min(), logits.max()
        return ((logits - low) / (high - low).clamp_min(1e-6)).numpy()

    return heat


def load_scenes(args, words, heat):
    """All frames and photographs in memory, as random training crops."""
    frames = []
    for pattern in args.frames:
        pattern, _, weight = pattern.partition("=")
        folders = sorted(glob.glob(pattern))
        some = [f for folder in folders for f in data.read_frames(folder, words, args.skip_box)]
        print(f"{pattern}: {len(some)} frames in {len(folders)} folders")
        frames.append((float(weight or 1), some))
    photos = []
    if args.photos:
        caches = args.out / "photos.npy", args.out / "segments.npy"
        segment = data.segmenter(args.segmenter)
        photos = list(data.read_photos(args.photos, words, heat, segment, caches))
    print(f"{len(photos)} photographs, {len(words.names)} words")
    return data.Scenes(frames, photos, words, (320, 224), args.photo_share, SEED,
                       args.screens)


def parameters(encoder, srd, rate):
    """The pretrained trunk learns slowly; its first blocks do not learn (see `early`)."""
    for module in (encoder.trunk.stem, *encoder.trunk.blocks[:6]):
        module.requires_grad_(False)
    trunk = [p for p in encoder.trunk.parameters() if p.requires_grad]
    fresh = [p for name, p in encoder.named_parameters() if not name.startswith("trunk")]
    return [{"params": trunk, "lr": rate * 0.15}, {"params": fresh + list(srd.parameters())}]


def save(encoder, srd, loss, words, path):
    """The weights, the words, and the scale and offset that the relevancy was fitted with."""
    asked = loss.asked.scale.item(), loss.asked.offset.item()
    torch.save({"encoder": encoder.state_dict(), "srd": srd.state_dict(), "words": words,
                "asked": asked}, path)


def train(encoder, srd, loss, scenes, args):
    """AdamW with a one-cycle rate; stops after --minutes or --steps; the last 30 % run at full
    resolution; the weights are saved every 200 steps."""
    groups = [*parameters(encoder, srd, args.rate), {"params": list(loss.asked.parameters())}]
    optimiser = torch.optim.AdamW(groups, lr=args.rate, weight_decay=1e-4)
    rates = [group["lr"] for group in optimiser.param_groups]
    started, limit, step = time.time(), args.minutes * 60, 0
    with tqdm(total=round(limit), unit="s", mininterval=10) as bar:
        for image, word, weight in data.batches(scenes, args.batch):
            done = step / args.steps if args.steps else (time.time() - started) / limit
            if done >= 1:
                return step
            scenes.size = SHAPE[::-1] if done > 0.7 else (320, 224)
            factor = min(step / 50, 1) * (0.02 + 0.98 * 0.5 * (1 + np.cos(np.pi * done)))
            for group, rate in zip(optimiser.param_groups, rates):
                group["lr"] = rate * factor
            image, word, weight = map(torch.from_numpy, (image, word, weight))
            if not (weight > 0).any():
                continue
            image = ((image - MEAN) / STD).contiguous(memory_format=torch.channels_last)
            with torch.autocast("cpu", torch.bfloat16):
                value, cosine, contrast, asked = loss(srd, encoder(image), word, weight)
            optimiser.zero_grad()
            value.backward()
            nn.utils.clip_grad_norm_([p for g in optimiser.param_groups for p in g["params"]], 2.0)
            optimiser.step()
            step += 1
            if step % 200 == 0:
                save(encoder, srd, loss, scenes.words.names, args.out / "encoder.pt")
            bar.update(int(time.time() - started) - bar.n)
            bar.set_postfix(step=step, cosine=f"{cosine:.3f}", contrast=f"{contrast:.2f}",
                            asked=f"{asked:.2f}")


def export(encoder, srd, folder):
    """encoder.onnx and srd.onnx for one image of the bundle's size."""
    example = torch.zeros(1, 3, *SHAPE)
    names = ["coarse", "skip8", "skip4"]
    encoder.eval(), srd.eval()
    with torch.inference_mode():
        maps = encoder(example)
    torch.onnx.export(encoder, (example,), str(folder / "encoder.onnx"), input_names=["image"],
                      output_names=names, opset_version=17, dynamo=False)
    torch.onnx.export(srd, tuple(m.clone() for m in maps), str(folder / "srd.onnx"),
                      input_names=names, output_names=["features"], opset_version=17, dynamo=False)


def load(path):
    """(encoder, srd) from a weights file, in eval mode."""
    encoder, srd = Encoder(), Srd()
    state = torch.load(path)
    encoder.load_state_dict(state["encoder"])
    srd.load_state_dict(state["srd"])
    return encoder.eval(), srd.eval()


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", action="append", default=[], metavar="GLOB[=WEIGHT]",
                        help="labelled folders; a frame is drawn in proportion to its weight")
    parser.add_argument("--skip-box", type=float, nargs=4, metavar=("X0", "Y0", "X1", "Y1"),
                        help="leave out views taken inside this box (metres)")
    parser.add_argument("--photos", type=Path, help="folder of photographs named ID_CLASS.jpg")
    parser.add_argument("--photo-share", type=float, default=0.25)
    parser.add_argument("--screens", type=float, default=0.0,
                        help="chance of drawn screens and prints on an image")
    parser.add_argument("--segmenter", type=Path, help="DeepLabV3 TFLite file (Pascal VOC)")
    parser.add_argument("--held-out", nargs="*", default=[], help="words that must not be learned")
    parser.add_argument("--backbone", type=Path, required=True, help="MobileNetV2 TFLite file")
    parser.add_argument("--text", type=Path, required=True, help="folder with text.onnx")
    parser.add_argument("--vocabulary", type=Path, help="nouns.json, for synonyms")
    parser.add_argument("--start", type=Path, help="continue from this encoder.pt")
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--steps", type=int, help="instead of --minutes")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--rate", type=float, default=1.5e-3)
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    args = parser.parse_args()
    torch.manual_seed(SEED)
    torch.set_num_threads(2)
    args.out.mkdir(parents=True, exist_ok=True)
    trunk, classifier = load_mobilenet(args.backbone)
    words = data.Words(args.vocabulary, args.held_out)
    scenes = load_scenes(args, words, activation(trunk, classifier))
    tower = TextEncoder(args.text, args.out / "texts.npz")
    table, negatives = torch.from_numpy(tower(words.names)), torch.from_numpy(tower(NEGATIVES))
    encoder, srd = load(args.start) if args.start else (Encoder(), Srd())
    if not args.start:
        encoder.trunk.load_state_dict(trunk.state_dict())
    encoder.train().to(memory_format=torch.channels_last)
    srd.train().to(memory_format=torch.channels_last)
    loss = Loss(table, Asked(table, negatives), torch.Generator().manual_seed(SEED))
    steps = train(encoder, srd, loss, scenes, args)
    save(encoder, srd, loss, words.names, args.out / "encoder.pt")
    export(encoder.to(memory_format=torch.contiguous_format),
           srd.to(memory_format=torch.contiguous_format), args.out)
    print(f"{steps} steps of {args.batch}; wrote {args.out}")


if __name__ == "__main__":
    main()
