"""Temperature and bias of the relevancy, and the confidence, that labelled frames ask for."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from ..samples import images
from ..samples.frames import read_all
from ..samples.words import Words
from .scores import iou

CUTS = 81  # margins that are tried for the best IoU
CONFIDENT = 0.001  # share of a frame's cells that must reach a score (the server's is similar)


@dataclass
class Relevancy:
    """What the margins of labelled frames ask for."""

    temperature: float
    logistic_bias: float  # of the logistic fit
    margin: float  # at which the mean IoU is best
    iou: float  # there

    @property
    def bias(self):
        """The bias with the best IoU at a relevancy of 0.5."""
        return self.temperature * self.margin


def fit(bundle, folders, every, least):
    """Prints temperature and bias for every n-th frame of labelled folders."""
    found = relevancy(bundle, labelled(folders, every), least)
    print(
        f"logistic fit: temperature {found.temperature:.2f}, bias {found.logistic_bias:.2f} (one "
        f"half at margin {found.logistic_bias / found.temperature:.3f}); IoU is best, "
        f"{found.iou:.3f}, at margin {found.margin:.3f}: bias {found.bias:.2f}"
    )


def labelled(folders, every=1):
    """[(rgb, label, names)]: every n-th frame of labelled folders, names by number."""
    frames = []
    for folder in folders:
        words = Words()
        frames += [(*frame, words.names) for frame in read_all(folder, words, every)]
    return frames


def relevancy(bundle, frames, least):
    """The `Relevancy` that fits labelled frames.

    Temperature and bias come from a logistic regression of "this pixel belongs to the word" on the
    margin, with both sides of equal weight. The margin is the one with the best IoU, mean over
    words. A word counts in frames with more of its pixels than `least` times the feature grid's
    cells.
    """
    margins, owned, groups = [], [], []
    for image, label, names in frames:
        seen = np.bincount(label[label >= 0], minlength=len(names))
        features = bundle.features(image)[0]
        size = features.shape[1::-1]
        label = images.resize(label.astype(np.int32), *size, images.NEAREST)
        asked = np.flatnonzero(seen > least * label.size)
        if not len(asked):
            continue
        words = [names[k] for k in asked]
        for k, margin in zip(asked, bundle.margin(features, words), strict=True):
            margins.append(margin.ravel())
            owned.append(label.ravel() == k)
            groups.append(names[k])
    every = np.concatenate(margins)
    temperature, bias = logistic(every, np.concatenate(owned))
    cuts = np.linspace(*np.quantile(every, (0.05, 0.999)), CUTS)
    table = defaultdict(list)
    for margin, own, word in zip(margins, owned, groups, strict=True):
        table[word].append([iou(margin > cut, own) for cut in cuts])
    mean = np.mean([np.mean(rows, 0) for rows in table.values()], 0)
    return Relevancy(temperature, bias, float(cuts[mean.argmax()]), float(mean.max()))


def peaks(bundle, frames, least):
    """(scores, there): scores of words in labelled frames, and whether the frame shows the word.

    A score is the relevancy that CONFIDENT of the cells reach. Words are those of all frames.
    """
    every = sorted({name for *_, names in frames for name in names})
    scores, there = [], []
    for image, label, names in frames:
        seen = np.bincount(label[label >= 0], minlength=len(names))
        share = dict(zip(names, seen / label.size, strict=False))
        asked = [word for word in every if not 0 < share.get(word, 0) <= least]
        maps = bundle.relevancy(bundle.features(image)[0], asked).reshape(len(asked), -1)
        at = max(1, round(CONFIDENT * maps.shape[1]))
        scores += np.sort(maps, 1)[:, -at].tolist()
        there += [share.get(word, 0) > least for word in asked]
    return np.array(scores), np.array(there)


def logistic(x, y):
    """(a, b) of the logistic 1 / (1 + exp(-(a x - b))) that fits y, by Newton's method.

    x is scaled for the computation, so that it may be small.
    """
    scale = max(np.abs(x).max(), 1e-9)
    x = x / scale
    weight = np.where(y, 0.5 / max(y.sum(), 1), 0.5 / max((~y).sum(), 1))
    a, b = 4.0, 0.0
    for _ in range(50):
        p = 1 / (1 + np.exp(-(a * x - b)))
        slope, curve = weight * (p - y), weight * p * (1 - p) + 1e-9 / len(x)
        hessian = [[(curve * x * x).sum(), -(curve * x).sum()], [-(curve * x).sum(), curve.sum()]]
        step = np.linalg.solve(hessian, [(slope * x).sum(), -slope.sum()])
        a, b = np.array([a, b]) - np.clip(step, -5, 5)
    return a / scale, b
