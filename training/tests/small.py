"""Small networks of the published classes with random weights that have an effect, and files."""

import open_clip
import torch
from torch import nn

from lexsplat_training.networks import clip_towers
from lexsplat_training.networks.published import AutoEncoder, SuperResolution
from lexsplat_training.networks.random_weights import calibrated, scattered

FEATURE = 128  # wide enough that folding is worth it, as at 768
TEXT = {"context_length": 77, "vocab_size": 49408, "width": 64, "heads": 4, "layers": 2}
CONVNEXT = {
    "timm_model_name": "convnext_atto",
    "timm_model_pretrained": False,
    "timm_pool": "",
    "timm_proj": "mlp",
    "timm_drop": 0.0,
    "timm_drop_path": 0.1,
    "image_size": 64,
}
VIT = {"image_size": 64, "patch_size": 16, "width": 64, "head_width": 16, "layers": 3}


def build(vision=CONVNEXT):
    """A CLIP of open_clip's own classes, a hundredth of the size."""
    torch.manual_seed(0)
    return scattered(open_clip.model.CLIP(FEATURE, vision, TEXT))


def published():
    """(CLIP, super-resolution decoder, auto-encoder)."""
    clip = build()
    torch.manual_seed(2)
    encoder = clip_towers.ConvNextDense(clip.visual)
    srd, auto_encoder = SuperResolution(FEATURE, encoder.skips), AutoEncoder(FEATURE)
    calibrated(encoder, scattered(srd), scattered(auto_encoder))
    return clip, srd, auto_encoder


def write_files(folder):
    """Writes the four weight files as they are published: with prefixes, in nested dictionaries."""
    clip, srd, auto_encoder = published()
    image = prefixed("sem_seg_head.predictor.clip_model.", clip)
    torch.save({"model": image, "iteration": 79999}, folder / "image.pth")
    torch.save(clip.state_dict(), folder / "text.bin")
    torch.save({"state_dict": prefixed("model.", srd), "epoch": 71}, folder / "srd.ckpt")
    torch.save({"state_dict": prefixed("model.", auto_encoder)}, folder / "ae.ckpt")
    return clip, srd, auto_encoder


def prefixed(prefix, module):
    """A module's state dict with a prefix before every name."""
    return {prefix + name: value for name, value in module.state_dict().items()}


def arguments(folder, *more):
    """The command line that reads these files."""
    files = {"image": "image.pth", "text": "text.bin", "srd": "srd.ckpt", "compressor": "ae.ckpt"}
    options = [part for name, file in files.items() for part in (f"--{name}", str(folder / file))]
    return [*options, "--size", "64", "96", *more]


class Pickled(nn.Linear):
    """A module that is saved as a whole object."""
