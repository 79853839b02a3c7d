"""The paper's super-resolution decoder and auto-encoder.

Parameters have the names of the released weight files, so that these load.
"""

import itertools

import torch
from torch import nn
from torch.nn import functional as F

from ..constants import CODE_SIZE
from .vectors import unit

ENCODER = (512, 256, 128, 64, CODE_SIZE)  # widths of the auto-encoder's layers
DECODER = (192, 256, 384, 512)


def normalised(convolution, channels):
    """A convolution, batch norm and ReLU."""
    return nn.Sequential(convolution, nn.BatchNorm2d(channels), nn.ReLU())


class Fusion(nn.Module):
    """Fuses features and a skip connection to features of the same shape: u + u * gate(u)."""

    def __init__(self, channels, skip):
        super().__init__()
        same = channels == skip
        self.low_res_align = nn.Identity() if same else nn.Conv2d(skip, channels, 1)
        self.fusion = normalised(nn.Conv2d(2 * channels, channels, 3, padding=1), channels)
        self.attention = nn.Sequential(
            *normalised(nn.Conv2d(channels, channels, 3, padding=1), channels),
            nn.Conv2d(channels, channels, 1),
            nn.Sigmoid(),
        )

    def forward(self, features, skip):
        skip = F.interpolate(skip, features.shape[2:], mode="bilinear", align_corners=False)
        fused = self.fusion(torch.cat([features, self.low_res_align(skip)], 1))
        return fused + fused * self.attention(fused)


def doubled(inputs, outputs):
    """Twice the resolution."""
    return normalised(nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1), outputs)


class SuperResolution(nn.Module):
    """dense [1, D, h, w], stage 1 [1, c1, 4h, 4w], stage 0 [1, c0, 8h, 8w] -> [1, D, 8h, 8w].

    Inputs as of `ConvNextDense`; skips = (c0, c1). The output is not normalised and has no sigmoid
    (paper section 4.1).
    """

    def __init__(self, feature=768, skips=(192, 384), widths=(512, 256, 128)):
        super().__init__()
        first, second, third = widths
        self.initial_conv = normalised(nn.Conv2d(feature, first, 3, padding=1), first)
        self.upsample1 = doubled(first, first)
        self.attention_fusion1 = Fusion(first, skips[1])
        self.upsample2 = doubled(first, second)
        self.attention_fusion2 = Fusion(second, skips[0])
        self.upsample3 = doubled(second, third)
        self.final_conv = nn.Conv2d(third, feature, 1)

    def forward(self, dense, middle, fine):
        x = self.attention_fusion1(self.upsample1(self.initial_conv(dense)), middle)
        x = self.attention_fusion2(self.upsample2(x), fine)
        return self.final_conv(self.upsample3(x))


class AutoEncoder(nn.Module):
    """Rows [n, D] -> [n, 32] -> [n, D], in the form in which it was trained (section 4.2)."""

    def __init__(self, feature=768, encoder=ENCODER, decoder=DECODER):
        super().__init__()
        sizes = (feature, *encoder)
        layers = [nn.Linear(sizes[0], sizes[1])]
        for inputs, outputs in itertools.pairwise(sizes[1:]):
            layers += [nn.BatchNorm1d(inputs), nn.ReLU(), nn.Linear(inputs, outputs)]
        self.encoder = nn.Sequential(*layers)
        sizes = (encoder[-1], *decoder, feature)
        layers = [nn.Linear(sizes[0], sizes[1])]
        for inputs, outputs in itertools.pairwise(sizes[1:]):
            layers += [nn.ReLU(), nn.Linear(inputs, outputs)]
        self.decoder = nn.Sequential(*layers)

    def forward(self, rows):
        return unit(self.decoder(unit(self.encoder(rows), 1)), 1)


class Compress(nn.Module):
    """The auto-encoder's first half on a map: [1, D, h, w] -> [1, 32, h, w] of unit length."""

    def __init__(self, auto_encoder):
        super().__init__()
        self.layers = nn.Sequential(*map(pointwise, auto_encoder.encoder))

    def forward(self, features):
        return unit(self.layers(features), 1)


class Decompress(nn.Module):
    """The auto-encoder's second half: [n, 32] -> [n, D] of unit length."""

    def __init__(self, auto_encoder):
        super().__init__()
        self.layers = auto_encoder.decoder

    def forward(self, codes):
        return unit(self.layers(codes), 1)


def pointwise(layer):
    """A layer for rows [n, D], turned into the same layer for the pixels of a map."""
    if isinstance(layer, nn.Linear):
        convolution = nn.Conv2d(layer.in_features, layer.out_features, 1)
        convolution.weight = nn.Parameter(layer.weight[:, :, None, None])
        convolution.bias = layer.bias
        return convolution
    if isinstance(layer, nn.BatchNorm1d):
        normalisation = nn.BatchNorm2d(layer.num_features, layer.eps)
        normalisation.load_state_dict(layer.state_dict())
        return normalisation.train(layer.training)
    return layer
