"""CLIP's towers (open_clip) as a bundle needs them: a feature per location, one per text."""

import open_clip
import torch
from torch import nn
from torch.nn import functional as F

from ..command_line import InputError
from .vectors import unit

# of RGB images in 0..255
MEAN = (122.7709383, 116.7460125, 104.09373615)
STD = (68.5005327, 66.6321579, 70.3231630)


def build(name):
    """An open_clip model by its name, with random weights."""
    known = open_clip.list_models()
    if name not in known:
        raise InputError(f"--model: {name!r} is no open_clip model; there are {', '.join(known)}")
    return open_clip.create_model(name, pretrained=None, load_weights=False).float().eval()


class ConvNextDense(nn.Module):
    """A tower of open_clip with a timm ConvNeXt trunk, without pooling (SED; Xie et al. 2024).

    Image [1, 3, H, W] -> dense [1, D, H/32, W/32] (the head at each location), and the outputs of
    stage 1 [1, c1, H/8, W/8] and stage 0 [1, c0, H/4, W/4].
    """

    def __init__(self, visual):
        super().__init__()
        self.trunk, self.head = visual.trunk, visual.head

    @property
    def skips(self):
        """Channels of stages 0 and 1."""
        return tuple(stage.blocks[-1].conv_dw.out_channels for stage in self.trunk.stages[:2])

    def forward(self, image):
        x, stages = self.trunk.stem(image), []
        for stage in self.trunk.stages:
            x = stage(x)
            stages.append(x)
        x = self.trunk.head.norm(self.trunk.norm_pre(x)).permute(0, 2, 3, 1)
        return self.head(x).permute(0, 3, 1, 2), stages[1], stages[0]


def attended(block, x, mask):
    """A block's attention, written out so that the export leaves the number of tokens free."""
    attention, (batch, _, width) = block.attn, x.shape
    heads = attention.num_heads
    qkv = F.linear(x, attention.in_proj_weight, attention.in_proj_bias)
    q, k, v = (
        part.reshape(batch, -1, heads, width // heads).transpose(1, 2) for part in qkv.chunk(3, -1)
    )
    scores = q @ k.transpose(-2, -1) / (width // heads) ** 0.5
    mixed = (scores if mask is None else scores + mask).softmax(-1) @ v
    return attention.out_proj(mixed.transpose(1, 2).reshape(batch, -1, width))


def own_values(block, x):
    """A block's attention if every token attended to itself only."""
    attention = block.attn
    width = x.shape[-1]
    value = F.linear(x, attention.in_proj_weight[2 * width :], attention.in_proj_bias[2 * width :])
    return attention.out_proj(value)


def through(block, x, mix):
    """A transformer block with `mix` as its attention."""
    x = x + block.ls_1(mix(block.ln_1(x)))
    return x + block.ls_2(block.mlp(block.ln_2(x)))


class VitDense(nn.Module):
    """An open_clip vision transformer for images of one size, in patches of `patch` pixels.

    Image [1, 3, H, W] -> [1, D, H/patch, W/patch] of unit length. In the last block every token
    attends to itself only (MaskCLIP; Zhou et al. 2022).
    """

    def __init__(self, visual, height, width):
        super().__init__()
        if not hasattr(visual, "conv1") or visual.attn_pool is not None or visual.proj is None:
            raise InputError("--model: expected a plain CLIP vision transformer with a projection")
        patch = visual.conv1.kernel_size[0]
        if height % patch or width % patch:
            raise InputError(
                f"--size: expected multiples of the patch, {patch}, found {height} {width}"
            )
        self.visual, self.grid = visual, (height // patch, width // patch)
        self.register_buffer("positions", positions(visual, self.grid))

    def forward(self, image):
        visual = self.visual
        patches = visual.conv1(image).flatten(2).transpose(1, 2)
        first = visual.class_embedding.expand(1, 1, -1)
        x = visual.ln_pre(torch.cat([first, patches], 1) + self.positions)
        *blocks, last = visual.transformer.resblocks
        for block in blocks:
            x = through(block, x, lambda tokens, block=block: attended(block, tokens, None))
        x = through(last, x, lambda tokens: own_values(last, tokens))
        features = visual.ln_post(x[:, 1:]) @ visual.proj
        return unit(features.transpose(1, 2).unflatten(2, self.grid), 1)


def positions(visual, grid):
    """The positional embedding for another grid: [1, 1 + rows * columns, width]."""
    embedding = visual.positional_embedding.detach()
    first, rest = embedding[:1], embedding[1:]
    rest = rest.T.reshape(1, -1, *visual.grid_size)
    if tuple(visual.grid_size) != tuple(grid):
        rest = F.interpolate(rest, grid, mode="bicubic", align_corners=False, antialias=True)
    return torch.cat([first, rest.flatten(2)[0].T])[None]


class TextTower(nn.Module):
    """CLIP's text transformer: tokens [1, n] -> [1, D] of unit length, n up to `context`.

    The embedding is read at the last token, which must be the end token.
    """

    def __init__(self, clip):
        super().__init__()
        # Some models of open_clip have the text tower's members themselves, others in `text`.
        text = getattr(clip, "text", clip)
        pool = getattr(clip, "text_pool_type", getattr(text, "pool_type", None))
        if pool not in ("argmax", "eos") or not hasattr(text, "attn_mask"):
            raise InputError(
                "--model: expected a text tower that is read at the end token; this one is "
                f"pooled by {pool!r}"
            )
        self.token_embedding, self.transformer = text.token_embedding, text.transformer
        self.ln_final, self.text_projection = text.ln_final, text.text_projection
        self.positional_embedding = text.positional_embedding

    @property
    def context(self):
        """Largest number of tokens."""
        return self.positional_embedding.shape[0]

    def forward(self, tokens):
        return unit(self.embedding(tokens), 1)

    def embedding(self, tokens):
        """The embedding before it is scaled to unit length."""
        length = tokens.shape[1]
        x = self.token_embedding(tokens) + self.positional_embedding[:length]
        # The mask is cut from a constant: the export cannot create one of a variable length.
        every = torch.full((self.context, self.context), -10_000.0).triu(1)
        mask = every[:length, :length]
        for block in self.transformer.resblocks:
            x = through(block, x, lambda tokens, block=block: attended(block, tokens, mask))
        end = self.ln_final(x[:, -1])
        projection = self.text_projection
        return projection(end) if isinstance(projection, nn.Linear) else end @ projection


def width(text):
    """Channels of a text tower's embedding."""
    projection = text.text_projection
    return projection.out_features if isinstance(projection, nn.Linear) else projection.shape[1]
