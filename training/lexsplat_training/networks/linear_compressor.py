"""A linear compressor, fitted to features: codes are coordinates along their leading directions."""

import torch
from torch import nn

from ..constants import CODE_SIZE
from .vectors import unit


class Compress(nn.Module):
    """[1, D, h, w] -> [1, 32, h, w] of unit length, along orthonormal directions [32, D]."""

    def __init__(self, directions):
        super().__init__()
        self.layer = nn.Conv2d(directions.shape[1], len(directions), 1, bias=False)
        self.layer.weight = nn.Parameter(directions[:, :, None, None].clone())

    def forward(self, features):
        return unit(self.layer(features), 1)


class Decompress(nn.Module):
    """[n, 32] -> [n, D] of unit length, along the same directions."""

    def __init__(self, directions):
        super().__init__()
        self.layer = nn.Linear(len(directions), directions.shape[1], bias=False)
        self.layer.weight = nn.Parameter(directions.T.clone())

    def forward(self, codes):
        return unit(self.layer(codes), 1)


def leading_directions(sources):
    """The CODE_SIZE directions that keep most of unit rows: sources of [n, D] -> [CODE_SIZE, D].

    Every source counts the same. Second moments are taken about zero, not about the mean, so that
    what all rows have in common is kept.
    """
    moments = sum(rows.double().T @ rows.double() / len(rows) for rows in sources)
    _, vectors = torch.linalg.eigh(moments)
    return vectors.T.flip(0)[:CODE_SIZE].float().contiguous()
