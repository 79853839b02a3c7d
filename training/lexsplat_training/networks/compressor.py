"""The generic compressor of models/tiny: features to codes and back (paper section 4.2)."""

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn

from ..constants import CODE_SIZE, FEATURE_SIZE
from .vectors import unit


class Compress(nn.Module):
    """Features [n, D, h, w] -> codes [n, 32, h, w]; 1x1 convolutions, so maps need no reshape."""

    def __init__(self, feature=FEATURE_SIZE, width=192):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(feature, width, 1),
            nn.ReLU(),
            nn.Conv2d(width, 96, 1),
            nn.ReLU(),
            nn.Conv2d(96, CODE_SIZE, 1),
        )
        self.straight = nn.Conv2d(feature, CODE_SIZE, 1)

    def forward(self, features):
        return unit(self.straight(features) + self.layers(features), 1)


class Decompress(nn.Module):
    """Codes [n, 32] -> features [n, D]."""

    def __init__(self, feature=FEATURE_SIZE):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(CODE_SIZE, 192),
            nn.ReLU(),
            nn.Linear(192, 320),
            nn.ReLU(),
            nn.Linear(320, feature),
        )
        self.straight = nn.Linear(CODE_SIZE, feature)

    def forward(self, codes):
        return unit(self.straight(codes) + self.layers(codes), 1)


def load(folder):
    """(Compress, Decompress) with the weights of compress.onnx and decompress.onnx.

    Bundles store large weights as fp16, with ".half" behind their names.
    """
    networks = Compress(), Decompress()
    for network, name in zip(networks, ("compress.onnx", "decompress.onnx"), strict=True):
        graph = onnx.load(folder / name).graph
        values = ((w.name, numpy_helper.to_array(w)) for w in graph.initializer)
        stored = {key.removesuffix(".half"): v.astype(np.float32) for key, v in values}
        state = {key: torch.from_numpy(stored[key].copy()) for key in network.state_dict()}
        network.load_state_dict(state)
    return networks
