"""Train the image encoder and the super-resolution decoder of models/tiny.

Learns from labelled frames and photographs to give every pixel the text embedding of its word.
Writes encoder.pt (the weights of both networks), encoder.onnx and srd.onnx; saves encoder.pt every
200 steps. With --minutes, training stops by the clock: a faster machine trains longer. --steps is
exact. The seed is fixed.
"""

import glob
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from ..command_line import parser
from ..constants import IMAGE_SHAPE, MEAN, NEGATIVES, STD
from ..export.graphs import export_encoder
from ..networks.encoder import Encoder, load
from ..networks.mobilenet import load_mobilenet
from ..networks.super_resolution import SuperResolution
from ..runtime.text_encoder import TextEncoder
from ..samples import images
from ..samples.batches import batches
from ..samples.frames import read_frames
from ..samples.photos import read_photos, segmenter
from ..samples.sampler import Sampler
from ..samples.words import Words
from .loss import Loss, RelevancyLoss

SEED = 20
CROP = (320, 224)  # (width, height) of samples in the first 70 % of training
EXAMPLE = """\
--frames 'rooms/*' --frames 'house=1.5' --photos imagenet-samples \\
      --backbone mobilenet_v2.tflite --segmenter deeplabv3.tflite --text text \\
      --vocabulary nouns.json --minutes 24 --out encoder"""


def activation(trunk, weight):
    """Class activation maps of an ImageNet classifier: (rgb, class) -> map 0..1 at stride 32.

    weight: the classifier's [1001, 1280], class 0 is the background.
    """
    trunk = trunk.eval().to(memory_format=torch.channels_last)

    @torch.inference_mode()
    def heat(image, index):
        x = torch.from_numpy(images.resize(image, 256, 256, images.BILINEAR).copy())
        x = (x.permute(2, 0, 1)[None].float() - MEAN) / STD
        logits = torch.einsum("chw,c->hw", trunk(x)[3][0], weight[index + 1])
        low, high = logits.min(), logits.max()
        return ((logits - low) / (high - low).clamp_min(1e-6)).numpy()

    return heat


def load_sampler(args, words, heat):
    """A sampler with all frames and photographs in memory."""
    frames = []
    for pattern in args.frames:
        pattern, _, weight = pattern.partition("=")
        folders = sorted(glob.glob(pattern))
        some = [f for folder in folders for f in read_frames(folder, words, args.skip_box)]
        print(f"{pattern}: {len(some)} frames in {len(folders)} folders")
        frames.append((float(weight or 1), some))
    photos = []
    if args.photos:
        caches = args.out / "photos.npy", args.out / "segments.npy"
        segment = segmenter(args.segmenter)
        photos = list(read_photos(args.photos, words, heat, segment, caches))
    print(f"{len(photos)} photographs, {len(words.names)} words")
    return Sampler(frames, photos, words, CROP, SEED, args.photo_share, args.screens)


def parameters(encoder, decoder, rate):
    """Parameter groups: the pretrained trunk learns at 0.15 of the rate, its first blocks not."""
    for module in (encoder.trunk.stem, *encoder.trunk.blocks[:6]):
        module.requires_grad_(False)
    trunk = [p for p in encoder.trunk.parameters() if p.requires_grad]
    fresh = [p for name, p in encoder.named_parameters() if not name.startswith("trunk")]
    return [{"params": trunk, "lr": rate * 0.15}, {"params": fresh + list(decoder.parameters())}]


def save(encoder, decoder, loss, words, path):
    """Saves the weights, the words, and the scale and offset of the relevancy loss ("asked")."""
    asked = loss.relevancy.scale.item(), loss.relevancy.offset.item()
    state = {"encoder": encoder.state_dict(), "srd": decoder.state_dict()}
    torch.save({**state, "words": words, "asked": asked}, path)


def train(encoder, decoder, loss, sampler, args):
    """Trains for --steps or --minutes; returns the number of steps.

    AdamW, rate warmed up over 50 steps and then falling as a cosine; the last 30 % at full
    resolution.
    """
    groups = [*parameters(encoder, decoder, args.rate), {"params": [*loss.relevancy.parameters()]}]
    optimiser = torch.optim.AdamW(groups, lr=args.rate, weight_decay=1e-4)
    rates = [group["lr"] for group in optimiser.param_groups]
    weights = [p for group in optimiser.param_groups for p in group["params"]]
    started, limit, step = time.time(), args.minutes * 60, 0
    with tqdm(total=round(limit), unit="s", mininterval=10) as bar:
        for image, word, weight in batches(sampler, args.batch):
            done = step / args.steps if args.steps else (time.time() - started) / limit
            if done >= 1:
                break
            sampler.size = IMAGE_SHAPE[::-1] if done > 0.7 else CROP
            factor = min(step / 50, 1) * (0.02 + 0.98 * 0.5 * (1 + np.cos(np.pi * done)))
            for group, rate in zip(optimiser.param_groups, rates, strict=True):
                group["lr"] = rate * factor
            image, word, weight = map(torch.from_numpy, (image, word, weight))
            if not (weight > 0).any():
                continue
            image = ((image - MEAN) / STD).contiguous(memory_format=torch.channels_last)
            with torch.autocast("cpu", torch.bfloat16):
                value, cosine, contrast, relevancy = loss(decoder, encoder(image), word, weight)
            optimiser.zero_grad()
            value.backward()
            nn.utils.clip_grad_norm_(weights, 2.0)
            optimiser.step()
            step += 1
            if step % 200 == 0:
                save(encoder, decoder, loss, sampler.words.names, args.out / "encoder.pt")
            bar.update(int(time.time() - started) - bar.n)
            shown = {"cosine": cosine, "contrast": contrast, "relevancy": relevancy}
            bar.set_postfix(step=step, **{key: f"{v:.3f}" for key, v in shown.items()})
    return step


def add_samples(add):
    """Adds the options that say what samples are drawn from."""
    add(
        "--frames",
        action="append",
        default=[],
        metavar="GLOB[=WEIGHT]",
        help="labelled folders; a frame is drawn in proportion to its weight (repeatable)",
    )
    add(
        "--skip-box",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="leave out frames taken inside this box (metres)",
    )
    add("--photos", type=Path, help="folder of photographs named ID_CLASS.jpg")
    add("--photo-share", type=float, default=0.25, help="share of photographs (default 0.25)")
    add("--screens", type=float, default=0.0, help="chance of drawn screens and prints (default 0)")
    add("--segmenter", type=Path, help="DeepLabV3 TFLite file (Pascal VOC), for --photos")
    add("--held-out", nargs="*", default=[], help="words that must not be learned")
    add("--backbone", type=Path, required=True, help="MobileNetV2 TFLite file")
    add("--text", type=Path, required=True, help="folder with text.onnx and tokenizer.json")
    add("--vocabulary", type=Path, help="nouns.json, for synonyms")


def arguments_parser():
    arguments = parser("train-encoder", __doc__, EXAMPLE)
    add = arguments.add_argument
    add_samples(add)
    add("--start", type=Path, help="continue from this encoder.pt")
    add("--minutes", type=float, default=20, help="training time (default 20)")
    add("--steps", type=int, help="number of steps, instead of --minutes")
    add("--batch", type=int, default=8, help="samples per step (default 8)")
    add("--rate", type=float, default=1.5e-3, help="peak learning rate (default 1.5e-3)")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    torch.manual_seed(SEED)
    torch.set_num_threads(2)
    args.out.mkdir(parents=True, exist_ok=True)
    trunk, classifier = load_mobilenet(args.backbone)
    words = Words(args.vocabulary, args.held_out)
    sampler = load_sampler(args, words, activation(trunk, classifier))
    tower = TextEncoder(args.text, args.out / "texts.npz")
    table, negatives = torch.from_numpy(tower(words.names)), torch.from_numpy(tower(NEGATIVES))
    encoder, decoder = load(args.start) if args.start else (Encoder(), SuperResolution())
    if not args.start:
        encoder.trunk.load_state_dict(trunk.state_dict())
    encoder.train().to(memory_format=torch.channels_last)
    decoder.train().to(memory_format=torch.channels_last)
    relevancy = RelevancyLoss(table, negatives)
    loss = Loss(table, relevancy, torch.Generator().manual_seed(SEED))
    steps = train(encoder, decoder, loss, sampler, args)
    save(encoder, decoder, loss, words.names, args.out / "encoder.pt")
    export_encoder(
        encoder.to(memory_format=torch.contiguous_format),
        decoder.to(memory_format=torch.contiguous_format),
        args.out,
    )
    print(f"{steps} steps of {args.batch}; wrote {args.out}")
