"""Scores a bundle on labelled frames of rendered rooms."""

import time
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from ..measure import calibration, scores
from ..runtime.bundle import Bundle


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
    """The `Score` of the bundle in a folder."""
    bundle, rows, seconds = Bundle(folder), defaultdict(list), []
    for image, label, names in frames:
        seen = np.bincount(label[label >= 0], minlength=len(names))
        asked = [names[k] for k in np.flatnonzero(seen > least * label.size)]
        started = time.perf_counter()
        bundle.features(image)
        seconds.append(time.perf_counter() - started)
        pairs = [(word, word) for word in asked]
        for word, found, _ in scores.score(bundle, (image, label), names, pairs):
            rows[word].append(found)
    words = {word: scores.mean(found) for word, found in sorted(rows.items())}
    values, there = calibration.peaks(bundle, frames, least)
    present = values >= bundle.manifest["relevancy"].get("present_threshold", 0.5)
    mean = {key: float(np.mean([getattr(one, key) for one in words.values()])) for key in MEANS}
    return Score(
        **mean,
        order=order(values, there),
        right=float((present[there].mean() + (~present[~there]).mean()) / 2),
        seconds=float(np.median(seconds)),
        words={word: (len(rows[word]), one.loc, one.iou) for word, one in words.items()},
    )


MEANS = ("loc", "iou", "chance")


def order(values, there):
    """How often a value of those that are there is the larger one of two."""
    ranks = values.argsort().argsort() + 1.0
    for value in np.unique(values):  # equal values share their mean rank
        same = values == value
        ranks[same] = ranks[same].mean()
    yes, no = there.sum(), (~there).sum()
    return float((ranks[there].sum() - yes * (yes + 1) / 2) / (yes * no))
