"""Scores of a word's relevancy in one frame, against the mask of the word."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from ..samples import images


class Scores(NamedTuple):
    """Scores of one word in one frame, or their means."""

    loc: float  # 1 if the peak of the relevancy lies in the mask
    loc_smoothed: float  # the same after a 5x5 mean
    iou: float  # at the bundle's threshold
    iou_paper: float  # of the paper's protocol (section 4): box-filtered, min-max normalised
    chance: float  # share of the mask in the frame: what a random peak reaches
    peak: float  # of the relevancy
    decoded: float  # mean cosine of features to themselves decoded from codes; NaN if unknown


def mean(rows):
    """The mean of several scores."""
    return Scores(*np.mean(rows, 0))


def box_filter(image, size):
    """Mean over a window of size x size, with borders repeated."""
    padded = np.pad(image, size // 2, mode="edge")
    total = np.pad(padded.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    h, w, k = *image.shape, size // 2 * 2 + 1
    top, bottom = total[:h], total[k : k + h]
    return (bottom[:, k : k + w] - top[:, k : k + w] - bottom[:, :w] + top[:, :w]) / k**2


def iou(found, mask):
    """Intersection over union of two boolean arrays."""
    return (found & mask).sum() / max((found | mask).sum(), 1)


def score(bundle, frame, names, asked):
    """Yields (text, Scores, the word that most of the mask's pixels are nearest to).

    frame: (rgb, word number per pixel); names: the words by number; asked: [(word, text)], where
    the text is asked for the word.
    """
    image, label = frame
    features, direct = bundle.features(image)
    h, w = features.shape[:2]
    label = images.resize(label.astype(np.int32), w, h, images.NEAREST)
    maps = bundle.relevancy(features, [text for _, text in asked])
    best = np.argmax(features @ bundle.text(names).T, -1)
    threshold = bundle.manifest["relevancy"]["threshold"]
    for (word, text), heat in zip(asked, maps, strict=True):
        mask = label == names.index(word)
        smooth = box_filter(heat, 5)
        mixed = (heat + smooth) / 2
        scaled = (mixed - mixed.min()) / max(np.ptp(mixed), 1e-6)
        guess = Counter(best[mask].tolist()).most_common(1)[0][0]
        found = Scores(
            loc=mask.flat[heat.argmax()],
            loc_smoothed=mask.flat[smooth.argmax()],
            iou=iou(heat > threshold, mask),
            iou_paper=iou(scaled > 0.75, mask),
            chance=mask.mean(),
            peak=heat.max(),
            decoded=np.nan if direct is None else (features * direct).sum(-1)[mask].mean(),
        )
        yield text, found, names[guess]
