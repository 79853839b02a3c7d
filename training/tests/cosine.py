"""How far two arrays agree."""

import numpy as np


def least_cosine(a, b, axis=1):
    """The least cosine between two arrays along an axis."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    assert a.shape == b.shape, (a.shape, b.shape)
    lengths = np.linalg.norm(a, axis=axis) * np.linalg.norm(b, axis=axis)
    return float(((a * b).sum(axis) / lengths).min())
