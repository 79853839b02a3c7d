"""The super-resolution decoder (SRD) of models/tiny (paper section 4.1)."""

import torch
from torch import nn
from torch.nn import functional as F

from ..constants import FEATURE_SIZE
from .layers import conv, double, rows_at
from .mobilenet import Convolution
from .vectors import unit


class Fusion(nn.Module):
    """Fuses a skip connection: concatenate, convolve, and gate by attention."""

    def __init__(self, width, skip, groups):
        super().__init__()
        self.join = conv(width + skip, width)
        self.spread = conv(width, width, 3, groups=groups)
        self.gate = nn.Sequential(conv(width, width // 4), Convolution(width // 4, width, 1))

    def forward(self, high, low):
        joined = self.join(torch.cat([high, low], 1))
        mixed = joined + self.spread(joined)
        return mixed + mixed * self.gate(mixed).sigmoid()


class SuperResolution(nn.Module):
    """coarse, skip8, skip4 (see `Encoder`) -> features [D, h/4, w/4] of unit length.

    Doubles the resolution twice and fuses a skip each time.
    """

    def __init__(self, width=128):
        super().__init__()
        self.enter = conv(FEATURE_SIZE, width)
        self.fuse8, self.fuse4 = Fusion(width, 32, width // 32), Fusion(width, 24, width)
        self.last = conv(width, width, 3, groups=width)
        self.leave = Convolution(width, FEATURE_SIZE, 1)

    def hidden(self, coarse, skip8, skip4):
        """The last map before the projection to D channels."""
        x = self.fuse8(double(self.enter(coarse)), skip8)
        x = self.fuse4(double(x), skip4)
        return x + self.last(x)

    def forward(self, coarse, skip8, skip4):
        return unit(self.leave(self.hidden(coarse, skip8, skip4)), 1)

    def at(self, hidden, image, y, x):
        """Features [n, D] of some pixels only: the whole map costs too much in training."""
        rows = rows_at(hidden, image, y, x)
        return unit(F.linear(rows, self.leave.weight[:, :, 0, 0], self.leave.bias), 1)
