"""EfficientNet-Lite2, with weights read from a PyTorch classifier (ImageNet, 1000 classes)."""

import torch
from torch import nn

from .mobilenet import Block, Conv

# expansion, output channels, repeats, stride of the first repeat, kernel size
BLOCKS = [
    (1, 16, 1, 1, 3),
    (6, 24, 3, 2, 3),
    (6, 48, 3, 2, 5),
    (6, 88, 4, 2, 3),
    (6, 120, 4, 1, 5),
    (6, 208, 5, 2, 5),
    (6, 352, 1, 1, 3),
]
EPSILON = 1e-3  # of the classifier's batch norms


class EfficientNet(nn.Module):
    """RGB in -1..1 -> maps at stride 8 (48 channels), 16 (120) and 32 (1280)."""

    def __init__(self):
        super().__init__()
        self.stem = Conv(3, 32, 3, 2)
        blocks, channels = [], 32
        for expansion, outputs, repeats, stride, size in BLOCKS:
            for repeat in range(repeats):
                step = stride if repeat == 0 else 1
                blocks.append(Block(channels, outputs, expansion, step, size))
                channels = outputs
        self.blocks = nn.ModuleList(blocks)
        self.head = Conv(352, 1280)

    def forward(self, x):
        x = self.stem(x)
        for block in self.blocks[:7]:
            x = block(x)
        fine = x
        for block in self.blocks[7:15]:
            x = block(x)
        middle = x
        for block in self.blocks[15:]:
            x = block(x)
        return fine, middle, self.head(x)


def folded(convolution, norm, state):
    """(weight, bias) of a convolution with its batch norm folded in; names without ".weight"."""
    scale = state[f"{norm}.weight"] / (state[f"{norm}.running_var"] + EPSILON).sqrt()
    bias = state[f"{norm}.bias"] - state[f"{norm}.running_mean"] * scale
    return state[f"{convolution}.weight"] * scale[:, None, None, None], bias


def load_efficientnet(path):
    """(EfficientNet, classifier weight [1000, 1280]) of a file in EfficientNet-PyTorch's names."""
    state, net = torch.load(path, map_location="cpu"), EfficientNet()
    pairs = [(net.stem, "_conv_stem", "_bn0"), (net.head, "_conv_head", "_bn1")]
    for number, block in enumerate(net.blocks):
        start = f"_blocks.{number}."
        if isinstance(block.expand, Conv):
            pairs.append((block.expand, f"{start}_expand_conv", f"{start}_bn0"))
        pairs.append((block.depthwise, f"{start}_depthwise_conv", f"{start}_bn1"))
        pairs.append((block.project, f"{start}_project_conv", f"{start}_bn2"))
    for module, convolution, norm in pairs:
        weight, bias = folded(convolution, norm, state)
        module.conv.weight.data.copy_(weight)
        module.conv.bias.data.copy_(bias)
    return net, state["_fc.weight"]
