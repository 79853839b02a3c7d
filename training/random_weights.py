"""Random weights with which every part of the networks matters: to try the machinery without files.

A fresh network is a poor test: its scales are nearly zero, its statistics are those of nothing, and
all pixels get the same code. Here scales and biases are random, and the normalisations get the
statistics of what really comes through on random images.
"""

import torch
from torch import nn


def scattered(module, seed=1):
    """Random scales and biases instead of zeros, ones and 1e-6."""
    random = torch.Generator().manual_seed(seed)
    for name, value in module.named_parameters():
        noise = torch.randn(value.shape, generator=random)
        with torch.no_grad():
            if name.endswith("gamma"):
                value.copy_(0.1 + 0.1 * noise.abs())
            elif value.dim() < 2 and value.numel() > 1:
                value.add_(0.2 * noise)
    return module.float().eval()


@torch.no_grad()
def calibrated(encoder, srd, auto_encoder, side=128, seed=1):
    """Statistics of the normalisations from two random images of `side` pixels."""
    random = torch.Generator().manual_seed(seed)
    coarse = torch.randn(2, 3, side // 16, side // 16, generator=random)
    image = nn.functional.interpolate(coarse, (side, side), mode="bilinear")
    for module in (srd, auto_encoder):
        for part in module.modules():
            if isinstance(part, (nn.BatchNorm1d, nn.BatchNorm2d)):
                part.momentum = None  # the mean of all batches: of this one
        module.train()
    features = srd(*encoder(image + 0.3 * torch.randn(image.shape, generator=random)))
    auto_encoder(features.permute(0, 2, 3, 1).reshape(-1, features.shape[1]))
    srd.eval()
    auto_encoder.eval()
