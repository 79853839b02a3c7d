"""Small networks of the published classes, with weights that do something, and their files."""

import open_clip
import torch
from torch import nn

import clip_towers
from published import AutoEncoder, SuperResolution
from random_weights import calibrated, scattered

FEATURE = 128  # wide enough that folding is worth it, as at 768
TEXT = dict(context_length=77, vocab_size=49408, width=64, heads=4, layers=2)
CONVNEXT = dict(timm_model_name="convnext_atto", timm_model_pretrained=False, timm_pool="",
                timm_proj="mlp", timm_drop=0.0, timm_drop_path=0.1, image_size=64)
VIT = dict(image_size=64, patch_size=16, width=64, head_width=16, layers=3)


def build(vision=None, text=None):
    """A CLIP of open_clip's own classes, a hundredth of the size."""
    torch.manual_seed(0)
    clip = open_clip.model.CLIP(FEATURE, vision or CONVNEXT, text or TEXT)
    return scattered(clip)


def published():
    """(clip, srd, auto-encoder)."""
    clip = build()
    torch.manual_seed(2)
    encoder = clip_towers.ConvNextDense(clip.visual)
    srd, auto_encoder = SuperResolution(FEATURE, encoder.skips), AutoEncoder(FEATURE)
    calibrated(encoder, scattered(srd), scattered(auto_encoder))
    return clip, srd, auto_encoder


def write_files(folder):
    """The four files as they come: below prefixes, inside a framework's dictionaries."""
    clip, srd, auto_encoder = published()
    below = lambda prefix, state: {prefix + name: value for name, value in state.items()}
    prefix = "sem_seg_head.predictor.clip_model."
    torch.save({"model": below(prefix, clip.state_dict()), "iteration": 79999},
               folder / "image.pth")
    torch.save(clip.state_dict(), folder / "text.bin")
    torch.save({"state_dict": below("model.", srd.state_dict()), "epoch": 71}, folder / "srd.ckpt")
    torch.save({"state_dict": below("model.", auto_encoder.state_dict())}, folder / "ae.ckpt")
    return clip, srd, auto_encoder


def arguments(folder, *more):
    """The command line that reads them."""
    return ["--image", str(folder / "image.pth"), "--text", str(folder / "text.bin"),
            "--srd", str(folder / "srd.ckpt"), "--compressor", str(folder / "ae.ckpt"),
            "--size", "64", "96", *more]


class Pickled(nn.Linear):
    """A module that somebody saved as a whole."""
