"""Talk2DINO (Barsellotti et al. 2025): DINOv2's patches, and CLIP's texts mapped to them.

Parameters have the names of the published file, so that they load.
"""

import timm
from timm.models.vision_transformer import checkpoint_filter_fn
from torch import nn

from ..command_line import InputError
from . import clip_towers, weights
from .vectors import unit

# of RGB images in 0..255 (ImageNet)
MEAN = (123.675, 116.28, 103.53)
STD = (58.395, 57.12, 57.375)
REGISTERS = "register_tokens"  # a tensor of DINOv2 that no other network has


def build(model, text, size):
    """(DINOv2 of timm, CLIP of open_clip) with random weights; size: rows, columns of images."""
    vision = timm.create_model(model, pretrained=False, num_classes=0, img_size=tuple(size))
    return vision.eval(), clip_towers.build(text)


class Patches(nn.Module):
    """Image [1, 3, H, W] -> the last layer's patches [1, D, H/patch, W/patch] of unit length."""

    def __init__(self, vision):
        super().__init__()
        self.vision, self.grid = vision, vision.patch_embed.grid_size

    def forward(self, image):
        tokens = self.vision.forward_features(image)[:, self.vision.num_prefix_tokens :]
        return unit(tokens.transpose(1, 2).unflatten(2, self.grid), 1)


class Mapping(nn.Module):
    """CLIP's embedding of a text [n, E] -> a direction among the patches [n, D]."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.linear_layer = nn.Linear(inputs, outputs)
        self.hidden_layers = nn.ModuleList([nn.Linear(outputs, outputs)])

    def forward(self, embedding):
        return self.hidden_layers[0](self.linear_layer(embedding).tanh())


class MappedText(nn.Module):
    """Tokens [1, n] -> [1, D] of unit length."""

    def __init__(self, text, mapping):
        super().__init__()
        self.text, self.mapping = text, mapping

    @property
    def context(self):
        """Largest number of tokens."""
        return self.text.context

    def forward(self, tokens):
        return unit(self.mapping(self.text.embedding(tokens)), 1)


def load(vision, clip, path):
    """(Patches, MappedText) with the weights of a published file."""
    tensors = weights.read(path)
    for old in [name for name in tensors if ".linear_layer2." in name]:
        tensors[old.replace("linear_layer2", "hidden_layers.0")] = tensors.pop(old)
    text = clip_towers.TextTower(clip)
    mapping = Mapping(clip_towers.width(text), vision.embed_dim)
    weights.fit(text, tensors, path, "text tower")
    weights.fit(mapping, tensors, path, "mapping from text to patches")
    # DINOv2's own names differ from timm's, whose filter also fits the grid of positions.
    found = [name for name in tensors if name.endswith(REGISTERS)]
    if not found:
        raise InputError(f"{path}: image tower: expected a tensor {REGISTERS!r}, found none")
    prefix = found[0].removesuffix(REGISTERS)
    own = {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}
    fitted = checkpoint_filter_fn(own, vision)
    weights.fit(vision, fitted, path, "image tower")
    return Patches(vision).eval(), MappedText(text, mapping).eval()
