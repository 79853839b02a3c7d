"""The image encoder of models/tiny: MobileNetV2 with a language head."""

import torch
from torch import nn

from ..constants import FEATURE_SIZE
from .layers import conv, double
from .mobilenet import Convolution, MobileNet
from .super_resolution import SuperResolution


class Encoder(nn.Module):
    """Image (normalised) -> coarse [D, h/16, w/16], skip8 [32, h/8, w/8], skip4 [24, h/4, w/4].

    D = FEATURE_SIZE; h, w: of the image (paper section 4.1).
    """

    def __init__(self, width=256):
        super().__init__()
        self.trunk = MobileNet()
        self.deep, self.middle = conv(1280, width), conv(96, width)
        self.mix = nn.Sequential(conv(width, width, 3, groups=width), conv(width, width))
        self.scene = nn.Linear(1280, width)
        self.project = Convolution(width, FEATURE_SIZE, 1)

    def forward(self, image):
        with torch.no_grad():  # these blocks keep the weights of ImageNet
            skip4, skip8 = self.trunk.early(image)
        middle, deep = self.trunk.late(skip8)
        scene = self.scene(deep.mean((2, 3)))[:, :, None, None]
        x = double(self.deep(deep)) + self.middle(middle) + scene
        return self.project(x + self.mix(x)), skip8, skip4


def load(path):
    """(Encoder, SuperResolution) with the weights of an encoder.pt, in evaluation mode."""
    encoder, decoder = Encoder(), SuperResolution()
    state = torch.load(path)
    encoder.load_state_dict(state["encoder"])
    decoder.load_state_dict(state["srd"])
    return encoder.eval(), decoder.eval()
