"""Score a bundle frame by frame: does the relevancy of a word find its object?

Everything runs through the exported graphs: image -> features -> 32-D codes -> decoded features ->
relevancy. Prints Loc (the peak lies in the object) and IoU at the bundle's threshold per word and
overall, beside the level that chance reaches, and what words are mistaken for. --images draws heat
maps of unlabelled images, --photos scores photographs, --fit finds the relevancy's temperature and
bias.
"""

import time
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from ..command_line import parser
from ..runtime.bundle import Bundle
from ..samples import images
from ..samples.frames import read_all
from ..samples.photos import class_of
from ..samples.words import Words
from . import heat_maps, scores
from .calibration import fit
from .phrases import PHRASES

EXAMPLE = "--bundle ../models/tiny --frames rooms/r7 --pictures heat"


def evaluate(bundle, folder, args):
    """Prints the scores of one folder, per text asked and overall."""
    words = Words()
    frames = read_all(folder, words, args.every)
    rows, guesses = defaultdict(list), defaultdict(Counter)
    absent = []  # peaks of words that the frame does not show
    for number, (image, label) in enumerate(frames):
        seen = np.bincount(label[label >= 0], minlength=len(words.names))
        asked = [words.names[k] for k in np.flatnonzero(seen > args.least * label.size)]
        if not asked:
            continue
        pairs = [(w, text) for w in asked for text in (PHRASES.get(w, []) if args.phrases else [w])]
        for text, values, guess in scores.score(bundle, (image, label), words.names, pairs):
            rows[text].append(values)
            guesses[text][guess] += 1
        features = bundle.features(image)[0]
        missing = [words.names[k] for k in np.flatnonzero(seen == 0)]
        if missing:
            absent += bundle.relevancy(features, missing).max((1, 2)).tolist()
        if args.pictures and number % args.picture_every == 0:
            path = args.pictures / f"{folder.name}-{number:03d}.png"
            heat_maps.write(image, bundle.relevancy(features, asked), asked, path)
    print(f"\n{folder}: {len(frames)} frames, words of at least {args.least:.1%} of a frame")
    print(
        "word                  frames   Loc  Loc5   IoU  IoUp chance  peak  most pixels taken for"
    )
    for word, values in sorted(rows.items(), key=lambda item: -len(item[1])):
        numbers = " ".join(f"{v:5.2f}" for v in scores.mean(values)[:6])
        print(f"{word:20} {len(values):7} {numbers}  {guesses[word].most_common(2)}")
    summarise(rows, absent, args.held_out)


def summarise(rows, absent, held_out):
    """Prints means over frames and over texts; rows: {text: [Scores]}, absent: peaks."""
    every = [one for values in rows.values() for one in values]
    classes = np.array([scores.mean(values) for values in rows.values()])
    report("all", scores.mean(every))
    report("mean of texts", scores.mean(classes))
    held = np.array([text in held_out for text in rows])
    if held.any():
        report("mean of held-out words", scores.mean(classes[held]))
        report("mean of the other words", scores.mean(classes[~held]))
    counts = [len(values) for values in rows.values()]
    most = sorted(range(len(rows)), key=lambda k: -counts[k])[:10]
    report("the ten most frequent", scores.mean(classes[most]))
    print(
        f"classes with Loc >= 0.5: {(classes[:, 0] >= 0.5).mean():.2f}; "
        f"peak when present: median {np.median([one.peak for one in every]):.2f}, when absent: "
        f"median {np.median(absent or [0]):.2f}, "
        f"90 % quantile {np.quantile(absent or [0], 0.9):.2f}"
    )


def report(name, mean):
    """Prints one line of means."""
    print(
        f"{name}: Loc {mean.loc:.3f}, Loc smoothed {mean.loc_smoothed:.3f}, IoU {mean.iou:.3f}, "
        f"IoU paper {mean.iou_paper:.3f}, chance {mean.chance:.3f}, "
        f"decoded cosine {mean.decoded:.3f}"
    )


def top5(bundle, folder):
    """Prints how often a photograph's class is among the five words nearest to its features."""
    files = sorted(folder.glob("*.jpg"))
    names = [class_of(path) for path in files]
    table, hits = bundle.text(names), []
    for path, name in zip(files, names, strict=True):
        features = bundle.features(images.read(path))[0]
        cosines = np.sort(features.reshape(-1, features.shape[-1]) @ table.T, 0)
        near = np.argsort(-cosines[-len(cosines) // 4 :].mean(0))[:5]
        hits.append([names[near[0]] == name, name in [names[k] for k in near]])
    first, five = np.mean(hits, 0)
    print(
        f"{folder}: {len(files)} photographs, top-1 {first:.3f}, top-5 {five:.3f}, "
        f"chance {5 / len(set(names)):.3f}"
    )


def draw(bundle, path, args):
    """Draws heat maps of --queries for an unlabelled image."""
    image = images.read(path)
    heats = bundle.relevancy(bundle.features(image)[0], args.queries)
    peaks = zip(args.queries, heats, strict=True)
    print(" ".join(f"{query} {heat.max():.2f}" for query, heat in peaks))
    heat_maps.write(image, heats, args.queries, (args.pictures or Path()) / f"{path.stem}.png")


def arguments_parser():
    arguments = parser("evaluate", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--bundle", type=Path, required=True, help="folder of a bundle")
    add(
        "--frames",
        type=Path,
        action="append",
        default=[],
        help="labelled folder, or a folder of such (repeatable)",
    )
    add("--every", type=int, default=1, help="use every n-th frame (default 1)")
    add(
        "--least",
        type=float,
        default=0.004,
        help="smallest share of a frame for a word to be asked (default 0.004)",
    )
    add("--pictures", type=Path, help="folder for heat maps")
    add("--picture-every", type=int, default=5, help="draw every n-th frame (default 5)")
    add("--images", type=Path, nargs="*", default=[], help="unlabelled images to draw")
    add("--queries", nargs="*", default=[], help="texts for --images")
    add("--held-out", nargs="*", default=[], help="words to report on their own")
    add("--phrases", action="store_true", help="ask phrases instead of words")
    add("--photos", type=Path, help="folder of photographs named ID_CLASS.jpg")
    add("--fit", action="store_true", help="fit temperature and bias to --frames, score nothing")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    bundle = Bundle(args.bundle)
    for path in args.images:
        draw(bundle, path, args)
    started = time.time()
    if args.photos:
        top5(bundle, args.photos)
    if args.fit:
        fit(bundle, args.frames, args.every, args.least)
    else:
        for folder in args.frames:
            evaluate(bundle, folder, args)
    print(f"{time.time() - started:.0f} s")
