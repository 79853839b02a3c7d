"""Random weights that give every part of a network an effect, to test exports without weight files.

A fresh network is a poor test: its scales are near zero and all pixels get the same code. Here
scales and biases are random, and batch norms have the statistics of random images.
"""

import torch
from torch import nn


def scattered(module, seed=1):
    """Randomises scales and biases in place of zeros, ones and 1e-6."""
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
    """Sets the batch norms' statistics from two random images of `side` pixels."""
    random = torch.Generator().manual_seed(seed)
    coarse = torch.randn(2, 3, side // 16, side // 16, generator=random)
    image = nn.functional.interpolate(coarse, (side, side), mode="bilinear")
    for module in (srd, auto_encoder):
        for part in module.modules():
            if isinstance(part, (nn.BatchNorm1d, nn.BatchNorm2d)):
                part.momentum = None  # the mean over all batches, here one
        module.train()
    features = srd(*encoder(image + 0.3 * torch.randn(image.shape, generator=random)))
    auto_encoder(features.permute(0, 2, 3, 1).reshape(-1, features.shape[1]))
    srd.eval()
    auto_encoder.eval()
