"""Scores a bundle on labelled frames of rendered rooms."""

import time
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from ..measure import calibration, scores
from ..runtime.bundle import Bundle
from ..samples import images

SIZE = (120, 90)  # columns, rows to which relevancies of all bundles are stretched


@dataclass
class Score:
    """Means over words of what a bundle does in labelled frames."""

    loc: float  # how often the peak of the relevancy lies in the object
    iou: float  # at the bundle's threshold
    chance: float  # how often a random peak lies in the object
    order: float  # how often a word that is there scores more than one that is not
    right: float  # how often "it is there" is right, both answers of equal weight
    seconds: float  # from a frame to features, median
    words: dict[str, tuple[int, float, float]]  # frames, loc and iou of each word


def score(folder, frames, least):
    """The `Score` of the bundle in a folder; `least`: share of a frame for a word to be asked."""
    bundle, rows, seconds = Bundle(folder, remember=True), defaultdict(list), []
    threshold = bundle.manifest["relevancy"]["threshold"]
    for image, label, names in frames:
        label = images.resize(label.astype(np.int32), *SIZE, images.NEAREST)
        seen = np.bincount(label[label >= 0], minlength=len(names))
        asked = np.flatnonzero(seen > least * label.size)
        started = time.perf_counter()
        features = bundle.features(image)[0]
        seconds.append(time.perf_counter() - started)
        heats = bundle.relevancy(features, [names[k] for k in asked]).astype(np.float32)
        for k, heat in zip(asked, heats, strict=True):
            heat, mask = images.resize(heat, *SIZE, images.BILINEAR), label == k
            found = mask.flat[heat.argmax()], scores.iou(heat > threshold, mask), mask.mean()
            rows[names[k]].append(found)
    words = {word: np.mean(found, 0) for word, found in sorted(rows.items())}
    loc, iou, chance = np.mean(list(words.values()), 0).tolist()
    values, there = calibration.peaks(bundle, frames, least)
    present = values >= bundle.manifest["relevancy"].get("present_threshold", threshold)
    return Score(
        loc=loc,
        iou=iou,
        chance=chance,
        order=order(values, there),
        right=float((present[there].mean() + (~present[~there]).mean()) / 2),
        seconds=float(np.median(seconds)),
        words={word: (len(rows[word]), mean[0], mean[1]) for word, mean in words.items()},
    )


def order(values, there):
    """How often a value of those that are there is the larger one of two."""
    ranks = values.argsort().argsort() + 1.0
    for value in np.unique(values):  # equal values share their mean rank
        same = values == value
        ranks[same] = ranks[same].mean()
    yes, no = there.sum(), (~there).sum()
    return float((ranks[there].sum() - yes * (yes + 1) / 2) / (yes * no))
