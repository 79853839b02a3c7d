"""The second image encoder of models/tiny: a frozen EfficientNet-Lite2 with a language head.

Its weights are those of the classifier, so it errs differently from the first encoder, which was
trained on rendered rooms. Features of both are added.
"""

import torch
from torch import nn
from torch.nn import functional as F

from ..constants import FEATURE_SIZE
from .efficientnet import load_efficientnet
from .layers import double
from .mobilenet import Convolution
from .vectors import unit

STRIDE = 8  # pixels per cell of the features, along each axis
SIZES = (48, 48, 48, 120, 120, 1280)  # channels of what `surroundings` returns


def surroundings(fine, middle, deep):
    """The trunk's maps and means of them: at stride 8 of 1, 3x3 and 7x7 cells, at 16 of 1, 3x3.

    The head sees one pixel at a time; the means tell it what is around.
    """

    def mean(x, size):
        return F.avg_pool2d(x, size, 1, size // 2, count_include_pad=False)

    return fine, mean(fine, 3), mean(fine, 7), middle, mean(middle, 3), deep


class Head(nn.Module):
    """Maps of the trunk -> features [D, h/8, w/8] of unit length; h, w: of the image.

    A perceptron per pixel. Its inputs are the maps around that pixel and the mean of the deepest
    map, which tells the kind of scene.
    """

    def __init__(self, width=384):
        super().__init__()
        self.parts = nn.ModuleList(Convolution(size, width, 1, bias=False) for size in SIZES)
        self.scene = Convolution(SIZES[-1], width, 1, bias=False)
        self.enter, self.inner = nn.BatchNorm2d(width), nn.BatchNorm2d(width)
        self.mix = Convolution(width, width, 1, bias=False)
        self.project = Convolution(width, FEATURE_SIZE, 1)

    def finish(self, x):
        """From the sum of all inputs' projections to features; drops channels in training."""
        x = F.relu(self.enter(x))
        x = x + F.relu(self.inner(self.mix(F.dropout(x, 0.1, self.training))))
        return unit(self.project(F.dropout(x, 0.1, self.training)), 1)

    def at_points(self, rows, scene):
        """Features [n, D] of points: `surroundings` there [n, sum of SIZES], scene [n, 1280]."""
        inputs = [part[:, :, None, None] for part in (*rows.split(SIZES, 1), scene)]
        layers = (*self.parts, self.scene)
        joined = sum(layer(x) for layer, x in zip(layers, inputs, strict=True))
        return self.finish(joined)[:, :, 0, 0]

    def forward(self, fine, middle, deep):
        around = surroundings(fine, middle, deep)
        *near, far, wide, deepest = (f(x) for f, x in zip(self.parts, around, strict=True))
        scene = self.scene(deep.mean((2, 3), keepdim=True))
        return self.finish(double(double(deepest) + far + wide) + sum(near) + scene)


class SecondEncoder(nn.Module):
    """Image (normalised) -> features [D, h/8, w/8] of unit length."""

    def __init__(self, trunk, head):
        super().__init__()
        self.trunk, self.head = trunk, head

    def forward(self, image):
        return self.head(*self.trunk(image))


def load(backbone, path):
    """A SecondEncoder of the trunk's weights and a head.pt, in evaluation mode."""
    head = Head()
    head.load_state_dict(torch.load(path)["head"])
    return SecondEncoder(load_efficientnet(backbone)[0], head).eval()
