"""The sentence encoder all-MiniLM-L6-v2 as a text tower, centred on a vocabulary."""

import json

import torch
from safetensors.torch import load_file
from torch import nn
from torch.nn import functional as F


class Layer(nn.Module):
    """A BERT layer: self-attention and a feed-forward block, each with a residual and a norm."""

    def __init__(self, width, heads, inner, eps):
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value, self.merge = (nn.Linear(width, width) for _ in range(4))
        self.norm1 = nn.LayerNorm(width, eps)
        self.up, self.down = nn.Linear(width, inner), nn.Linear(inner, width)
        self.norm2 = nn.LayerNorm(width, eps)

    def forward(self, x, bias):
        b, t, d = x.shape
        q, k, v = (
            f(x).reshape(b, t, self.heads, d // self.heads).transpose(1, 2)
            for f in (self.query, self.key, self.value)
        )
        weights = (q @ k.transpose(2, 3) * (d // self.heads) ** -0.5 + bias).softmax(-1)
        x = self.norm1(x + self.merge((weights @ v).transpose(1, 2).reshape(b, t, d)))
        return self.norm2(x + self.down(F.gelu(self.up(x))))


class TextTower(nn.Module):
    """Token ids [n, t] -> [n, D] of unit length.

    BERT, mean over tokens, unit length, minus `centre`, unit length again. With the vocabulary's
    mean embedding as `centre`, unrelated nouns have a cosine near 0, and the relevancy (paper
    section 5) compares what differs between nouns rather than what all nouns share.
    """

    def __init__(self, config):
        super().__init__()
        width, eps = config["hidden_size"], config["layer_norm_eps"]
        self.words = nn.Embedding(config["vocab_size"], width)
        self.positions = nn.Embedding(config["max_position_embeddings"], width)
        self.types = nn.Embedding(config["type_vocab_size"], width)
        self.norm = nn.LayerNorm(width, eps)
        self.layers = nn.ModuleList(
            Layer(width, config["num_attention_heads"], config["intermediate_size"], eps)
            for _ in range(config["num_hidden_layers"])
        )
        self.register_buffer("centre", torch.zeros(width))

    def forward(self, input_ids, attention_mask, token_type_ids):
        place = torch.arange(input_ids.shape[1], device=input_ids.device)[None]
        x = self.words(input_ids) + self.positions(place) + self.types(token_type_ids)
        x = self.norm(x)
        mask = attention_mask.to(x.dtype)
        bias = (1 - mask)[:, None, None, :] * -1e4
        for layer in self.layers:
            x = layer(x, bias)
        pooled = (x * mask[..., None]).sum(1) / mask.sum(1, keepdim=True)
        return F.normalize(F.normalize(pooled, dim=-1) - self.centre, dim=-1)


def load_tower(folder):
    """The tower with the weights of a folder (model.safetensors, config.json); centre 0."""
    tower = TextTower(json.loads((folder / "config.json").read_text()))
    names = {
        "embeddings.word_embeddings": "words",
        "embeddings.position_embeddings": "positions",
        "embeddings.token_type_embeddings": "types",
        "embeddings.LayerNorm": "norm",
        "attention.self.": "",
        "attention.output.dense": "merge",
        "attention.output.LayerNorm": "norm1",
        "intermediate.dense": "up",
        "output.dense": "down",
        "output.LayerNorm": "norm2",
        "encoder.layer.": "layers.",
    }
    state = {}
    for key, value in load_file(folder / "model.safetensors").items():
        for old, new in names.items():
            key = key.replace(old, new)
        if not key.startswith("pooler") and "position_ids" not in key:
            state[key] = value
    missing, unexpected = tower.load_state_dict(state, strict=False)
    assert missing == ["centre"] and not unexpected, (missing, unexpected)
    return tower.eval()


def embed(tower, tokenizer, texts, batch=64):
    """Embeddings [len(texts), D] of a list of strings."""
    rows = []
    for start in range(0, len(texts), batch):
        ids = [tokenizer.encode(text).ids for text in texts[start : start + batch]]
        mask = torch.zeros(len(ids), max(map(len, ids)), dtype=torch.int64)
        padded = mask.clone()
        for row, tokens in enumerate(ids):
            mask[row, : len(tokens)] = 1
            padded[row, : len(tokens)] = torch.tensor(tokens)
        with torch.inference_mode():
            rows.append(tower(padded, mask, torch.zeros_like(mask)))
    return torch.cat(rows)
