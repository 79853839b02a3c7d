"""Per-pixel evaluation of a bundle: does the word find its object in frames never trained on?

In:  a bundle folder (manifest.toml and ONNX files) and labelled frames (--frames), photographs
     named ID_CLASS.jpg (--photos), or plain images (--images) with --queries, for heat maps only.
Out: Loc (the peak of the relevancy lies inside the object), IoU at the bundle's threshold, the
     same for the paper's protocol (section 4: box-filtered, min-max normalised), the level that
     chance reaches, the confusions, heat maps as PNG (--pictures); the same for words of no
     training image (--held-out) and for phrases of PHRASES (--phrases); with --fit the
     temperature and bias of the relevancy that the frames ask for.

Everything runs through the exported graphs: image -> encoder -> SRD -> 32-D codes -> decoder ->
relevancy against the bundle's negatives.
"""

import argparse
import time
import tomllib
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import onnxruntime
from PIL import Image

import data
from text import TextEncoder


# Other ways to say a word of the frames. None was a word or a synonym in training.
PHRASES = {
    "sofa": ["settee", "something soft to sit on with friends"],
    "bed": ["where one lies down at night", "mattress"],
    "chair": ["something to sit on", "seat"],
    "trash can": ["something to throw rubbish in", "waste basket"],
    "television": ["telly", "something to watch films on"],
    "tv screen": ["telly", "something to watch films on"],
    "curtain": ["drapes", "cloth in front of the window"],
    "refrigerator": ["fridge", "where the food is kept cold"],
    "wardrobe": ["closet", "where the clothes hang"],
    "nightstand": ["bedside table", "little cabinet next to the bed"],
    "desk": ["writing table", "where one works"],
    "air conditioner": ["ac unit", "something that cools the room"],
    "picture": ["painting", "something that decorates the wall"],
    "carpet": ["mat on the floor", "rug on the ground"],
    "window": ["where daylight comes in"],
    "door": ["where one leaves the room"],
    "lamp": ["light fixture", "something that gives light"],
    "mug": ["something to drink coffee from"],
    "book": ["something to read"],
    "potted plant": ["houseplant"],
}


class Bundle:
    """The graphs of a bundle, chained as the manifest says."""

    def __init__(self, folder):
        self.manifest = tomllib.loads((folder / "manifest.toml").read_text())
        m, self.folder = self.manifest, folder
        self.encoder, self.srd = self.session(m["encoder"]["file"]), self.session(m["srd"]["file"])
        self.compress = self.session(m["compressor"]["encoder"]["file"])
        self.decompress = self.session(m["compressor"]["decoder"]["file"])
        self.text = TextEncoder(folder)
        self.negatives = self.text(m["relevancy"]["negatives"])

    def session(self, name):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 2
        return onnxruntime.InferenceSession(str(self.folder / name), options)

    def tensor(self, image):
        """A frame as the encoder's input."""
        m = self.manifest["image"]
        x = data.resize(image, m["width"], m["height"], Image.Resampling.BILINEAR)
        x = (x.astype(np.float32) - m["mean"]) / m["std"]
        return x.transpose(2, 0, 1)[None].astype(np.float32)

    def features(self, image):
        """(decoded features [h, w, D], direct features [h, w, D]), unit length."""
        maps = self.encoder.run(None, {"image": self.tensor(image)})
        inputs = dict(zip(self.manifest["srd"]["inputs"], maps))
        direct = self.srd.run(None, inputs)[0]
        codes = self.compress.run(None, {"features": direct})[0][0]
        flat = np.ascontiguousarray(codes.reshape(len(codes), -1).T)
        decoded = self.decompress.run(None, {"codes": flat})[0]
        return decoded.reshape(*codes.shape[1:], -1), direct[0].transpose(1, 2, 0)

    def relevancy(self, features, words):
        """[words, h, w]: the least of the pairwise softmaxes against the negatives."""
        m = self.manifest["relevancy"]
        logit = m["temperature"] * self.margin(features, words) - m.get("bias", 0.0)
        return 1 / (1 + np.exp(-logit))

    def margin(self, features, words):
        """[words, h, w]: how much nearer a feature is to the word than to a negative (cosines)."""
        against = (features @ self.negatives.T).max(-1)
        return (features @ self.text(words).T - against[..., None]).transpose(2, 0, 1)


def box(image, size):
    """Mean over a size x size window, borders repeated."""
    padded = np.pad(image, size // 2, mode="edge")
    total = np.pad(padded.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    h, w, k = *image.shape, size // 2 * 2 + 1
    return (total[k:k + h, k:k + w] - total[:h, k:k + w] - total[k:k + h, :w] + total[:h, :w]) / k**2


def iou(found, mask):
    """Intersection over union."""
    return (found & mask).sum() / max((found | mask).sum(), 1)


def colors(heat):
    """A black-red-yellow-white ramp for values 0..1."""
    heat = heat.clip(0, 1)[..., None] * 3
    return (np.concatenate([heat, heat - 1, heat - 2], -1).clip(0, 1) * 255).astype(np.uint8)


def picture(image, heats, words, path):
    """The image and one heat map per word (0.3..0.9 of relevancy), side by side."""
    height, width = 216, 288
    tiles = [np.asarray(Image.fromarray(image).resize((width, height)))]
    for heat in heats:
        ramp = Image.fromarray(colors((heat - 0.3) / 0.6)).resize((width, height))
        tiles.append((0.35 * tiles[0] + 0.65 * np.asarray(ramp)).astype(np.uint8))
    columns = 4
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[k:k + columns], 1) for k in range(0, len(tiles), columns)]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(rows)).save(path)
    print(f"{path}: {', '.join(words)}")


def score(bundle, image, label, names, asked):
    """Per (word, text) asked: the text and its row of scores, and what the word is taken for."""
    features, direct = bundle.features(image)
    h, w = features.shape[:2]
    label = data.resize(label.astype(np.int32), w, h, Image.Resampling.NEAREST)
    maps = bundle.relevancy(features, [text for _, text in asked])
    best = np.argmax(features @ bundle.text(names).T, -1)
    for (word, text), heat in zip(asked, maps):
        mask = label == names.index(word)
        peak = mask.flat[heat.argmax()]
        smooth = box(heat, 5)
        mixed = (heat + smooth) / 2
        scaled = (mixed - mixed.min()) / max(np.ptp(mixed), 1e-6)
        guess = Counter(best[mask].tolist()).most_common(1)[0][0]
        yield text, np.array([
            peak, mask.flat[smooth.argmax()],
            iou(heat > bundle.manifest["relevancy"]["threshold"], mask), iou(scaled > 0.75, mask),
            mask.mean(), heat.max(), (features * direct).sum(-1)[mask].mean(),
        ]), names[guess]


def frames_of(folder, words, every):
    """Every n-th frame of a labelled folder, or of all labelled folders in it."""
    folders = [folder] if (folder / "traj.txt").exists() else sorted(folder.iterdir())
    return [f for one in folders for f in data.read_frames(one, words)][::every]


def evaluate(bundle, folder, args):
    """Scores of one folder, per word and overall."""
    words = data.Words()
    frames = frames_of(folder, words, args.every)
    rows, guesses = defaultdict(list), defaultdict(Counter)
    absent = []
    for number, (image, label) in enumerate(frames):
        seen = np.bincount(label[label >= 0], minlength=len(words.names))
        asked = [words.names[k] for k in np.flatnonzero(seen > args.least * label.size)]
        if not asked:
            continue
        pairs = [(w, text) for w in asked for text in (PHRASES.get(w, []) if args.phrases else [w])]
        for text, values, guess in score(bundle, image, label, words.names, pairs):
            rows[text].append(values)
            guesses[text][guess] += 1
        features = bundle.features(image)[0]
        missing = [words.names[k] for k in np.flatnonzero(seen == 0)]
        if missing:
            absent += bundle.relevancy(features, missing).max((1, 2)).tolist()
        if args.pictures and number % args.picture_every == 0:
            picture(image, bundle.relevancy(features, asked), asked,
                    args.pictures / f"{folder.name}-{number:03d}.png")
    print(f"\n{folder}: {len(frames)} frames, words of at least {args.least:.1%} of a frame")
    print("word                  frames   Loc  Loc5   IoU  IoUp chance  peak  most pixels taken for")
    for word, values in sorted(rows.items(), key=lambda item: -len(item[1])):
        mean = np.mean(values, 0)
        numbers = " ".join(f"{v:5.2f}" for v in mean[:6])
        print(f"{word:20} {len(values):7} {numbers}  {guesses[word].most_common(2)}")
    table = np.concatenate([np.array(v) for v in rows.values()])
    classes = np.array([np.mean(v, 0) for v in rows.values()])
    peaks = np.concatenate([[v[5] for v in values] for values in rows.values()])
    report("all", table.mean(0))
    report("mean of texts", classes.mean(0))
    held = np.array([text in args.held_out for text in rows])
    if held.any():
        report("mean of held-out words", classes[held].mean(0))
        report("mean of the other words", classes[~held].mean(0))
    most = sorted(range(len(rows)), key=lambda k: -len(list(rows.values())[k]))[:10]
    report("the ten most frequent", classes[most].mean(0))
    print(f"classes with Loc >= 0.5: {(classes[:, 0] >= 0.5).mean():.2f}; "
          f"peak when present: median {np.median(peaks):.2f}, when absent: "
          f"median {np.median(absent or [0]):.2f}, 90 % quantile {np.quantile(absent or [0], .9):.2f}")
    return classes.mean(0)


def fit(bundle, folders, args):
    """Temperature and bias: logistic regression of "pixel belongs to the word" on the margin, in
    which both sides weigh the same; then the bias at which IoU at 0.5 is best, word by word."""
    margins, owned, groups = [], [], []
    for folder in folders:
        words = data.Words()
        for image, label in frames_of(folder, words, args.every):
            seen = np.bincount(label[label >= 0], minlength=len(words.names))
            features = bundle.features(image)[0]
            label = data.resize(label.astype(np.int32), *features.shape[1::-1],
                                Image.Resampling.NEAREST)
            asked = np.flatnonzero(seen > args.least * label.size)
            for k, margin in zip(asked, bundle.margin(features, [words.names[k] for k in asked])):
                margins.append(margin.ravel())
                owned.append(label.ravel() == k)
                groups.append(words.names[k])
    x, y = np.concatenate(margins), np.concatenate(owned)
    weight = np.where(y, 0.5 / y.sum(), 0.5 / (~y).sum())
    a, b = 8.0, 0.0
    for _ in range(50):  # Newton's method
        p = 1 / (1 + np.exp(-(a * x - b)))
        slope, curve = weight * (p - y), weight * p * (1 - p)
        hessian = [[(curve * x * x).sum(), -(curve * x).sum()], [-(curve * x).sum(), curve.sum()]]
        a, b = np.array([a, b]) - np.linalg.solve(hessian, [(slope * x).sum(), -slope.sum()])
    cuts = np.linspace(0, 0.8, 81)
    table = defaultdict(list)
    for margin, own, word in zip(margins, owned, groups):
        table[word].append([iou(margin > cut, own) for cut in cuts])
    mean = np.mean([np.mean(rows, 0) for rows in table.values()], 0)
    best = cuts[mean.argmax()]
    print(f"logistic fit: temperature {a:.2f}, bias {b:.2f} (one half at margin {b / a:.3f}); IoU "
          f"is best, {mean.max():.3f}, at margin {best:.2f}: bias {a * best:.2f}")


def top5(bundle, folder):
    """Of how many photographs the class is among the five words nearest to their features."""
    files = sorted(folder.glob("*.jpg"))
    names = [path.stem.split("_", 1)[1].replace("_", " ") for path in files]
    table, hits = bundle.text(names), []
    for path, name in zip(files, names):
        features = bundle.features(np.asarray(Image.open(path).convert("RGB")))[0]
        cosines = np.sort(features.reshape(-1, features.shape[-1]) @ table.T, 0)
        near = np.argsort(-cosines[-len(cosines) // 4:].mean(0))[:5]
        hits.append([names[near[0]] == name, name in [names[k] for k in near]])
    first, five = np.mean(hits, 0)
    print(f"{folder}: {len(files)} photographs, top-1 {first:.3f}, top-5 {five:.3f}, "
          f"chance {5 / len(set(names)):.3f}")


def report(name, mean):
    """One line of means."""
    print(f"{name}: Loc {mean[0]:.3f}, Loc smoothed {mean[1]:.3f}, IoU {mean[2]:.3f}, "
          f"IoU paper {mean[3]:.3f}, chance {mean[4]:.3f}, decoded cosine {mean[6]:.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bundle", type=Path, required=True)
    parser.add_argument("--frames", type=Path, action="append", default=[])
    parser.add_argument("--every", type=int, default=1, help="use every n-th frame")
    parser.add_argument("--least", type=float, default=0.004, help="least area of a word asked")
    parser.add_argument("--pictures", type=Path, help="folder for heat maps")
    parser.add_argument("--picture-every", type=int, default=5)
    parser.add_argument("--images", type=Path, nargs="*", default=[], help="unlabelled images")
    parser.add_argument("--queries", nargs="*", default=[])
    parser.add_argument("--held-out", nargs="*", default=[], help="words to report on their own")
    parser.add_argument("--phrases", action="store_true", help="ask phrases, not words")
    parser.add_argument("--photos", type=Path, help="photographs, one class each")
    parser.add_argument("--fit", action="store_true", help="fit the relevancy to --frames")
    args = parser.parse_args()
    bundle = Bundle(args.bundle)
    for path in args.images:
        image = np.asarray(Image.open(path).convert("RGB"))
        heats = bundle.relevancy(bundle.features(image)[0], args.queries)
        print(" ".join(f"{q} {h.max():.2f}" for q, h in zip(args.queries, heats)))
        picture(image, heats, args.queries, (args.pictures or Path()) / f"{path.stem}.png")
    started = time.time()
    if args.photos:
        top5(bundle, args.photos)
    if args.fit:
        fit(bundle, args.frames, args)
    for folder in [] if args.fit else args.frames:
        evaluate(bundle, folder, args)
    print(f"{time.time() - started:.0f} s")


if __name__ == "__main__":
    main()
