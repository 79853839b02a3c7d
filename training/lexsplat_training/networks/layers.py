"""Layers that the image encoder and the decoder behind it share."""

from torch import nn
from torch.nn import functional as F

from .mobilenet import Convolution


def double(x):
    """Twice the resolution, bilinear."""
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def conv(inputs, outputs, size=1, groups=1):
    """Convolution, batch norm, ReLU."""
    return nn.Sequential(
        Convolution(inputs, outputs, size, padding=size // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    )


def rows_at(maps, image, y, x):
    """The channels of some pixels: [n, C] from maps [b, C, h, w] at image, y, x, each [n]."""
    _, channels, height, width = maps.shape
    flat = maps.permute(0, 2, 3, 1).reshape(-1, channels)
    return flat.index_select(0, (image * height + y) * width + x)
