"""Temperature and bias of the relevancy that labelled frames ask for."""

from collections import defaultdict

import numpy as np

from ..samples import images
from ..samples.frames import read_all
from ..samples.words import Words
from .scores import iou


def fit(bundle, folders, every, least):
    """Prints temperature and bias for every n-th frame of labelled folders.

    Both come from a logistic regression of "this pixel belongs to the word" on the margin, with
    both sides of equal weight. The second bias is the one with the best IoU at 0.5, mean over
    words. A word counts in frames with more of its pixels than `least` times the feature grid's
    cells.
    """
    margins, owned, groups = [], [], []
    for folder in folders:
        words = Words()
        for image, label in read_all(folder, words, every):
            seen = np.bincount(label[label >= 0], minlength=len(words.names))
            features = bundle.features(image)[0]
            size = features.shape[1::-1]
            label = images.resize(label.astype(np.int32), *size, images.NEAREST)
            asked = np.flatnonzero(seen > least * label.size)
            names = [words.names[k] for k in asked]
            for k, margin in zip(asked, bundle.margin(features, names), strict=True):
                margins.append(margin.ravel())
                owned.append(label.ravel() == k)
                groups.append(words.names[k])
    temperature, bias = logistic(np.concatenate(margins), np.concatenate(owned))
    cuts = np.linspace(0, 0.8, 81)
    table = defaultdict(list)
    for margin, own, word in zip(margins, owned, groups, strict=True):
        table[word].append([iou(margin > cut, own) for cut in cuts])
    mean = np.mean([np.mean(rows, 0) for rows in table.values()], 0)
    best = cuts[mean.argmax()]
    print(
        f"logistic fit: temperature {temperature:.2f}, bias {bias:.2f} (one half at margin "
        f"{bias / temperature:.3f}); IoU is best, {mean.max():.3f}, at margin {best:.2f}: "
        f"bias {temperature * best:.2f}"
    )


def logistic(x, y):
    """(a, b) of the logistic 1 / (1 + exp(-(a x - b))) that fits y, by Newton's method."""
    weight = np.where(y, 0.5 / y.sum(), 0.5 / (~y).sum())
    a, b = 8.0, 0.0
    for _ in range(50):
        p = 1 / (1 + np.exp(-(a * x - b)))
        slope, curve = weight * (p - y), weight * p * (1 - p)
        hessian = [[(curve * x * x).sum(), -(curve * x).sum()], [-(curve * x).sum(), curve.sum()]]
        a, b = np.array([a, b]) - np.linalg.solve(hessian, [(slope * x).sum(), -slope.sum()])
    return a, b
