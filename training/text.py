"""Text tower: all-MiniLM-L6-v2 as one ONNX graph, centred on a vocabulary and quantised to int8.

In:  the folder of the sentence encoder (model.safetensors, config.json, tokenizer.json) and a
     vocabulary (a JSON list of rows with "name"), both given as arguments.
Out: text.onnx (input_ids, attention_mask, token_type_ids -> embedding [1, D], unit length)
     and tokenizer.json.

The graph pools the mean over tokens, normalises, subtracts the mean embedding of the vocabulary
and normalises again: two unrelated nouns then have a cosine near 0, so that the relevancy of the
paper (section 5) compares what differs between nouns instead of what all nouns share.
"""

import argparse
import json
import shutil
import time
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import helper, numpy_helper
from safetensors.torch import load_file
from tokenizers import Tokenizer
from torch import nn
from torch.nn import functional as F

MAX_TOKENS = 64
INPUTS = ["input_ids", "attention_mask", "token_type_ids"]


class Layer(nn.Module):
    """One BERT layer: self-attention and a feed-forward block, each with a residual and a norm."""

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
    """Token ids to a unit vector: BERT, mean pooling, centring, L2 norm."""

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
    """The tower with the published weights; tensor names are translated to ours."""
    tower = TextTower(json.loads((folder / "config.json").read_text()))
    names = {
        "embeddings.word_embeddings": "words", "embeddings.position_embeddings": "positions",
        "embeddings.token_type_embeddings": "types", "embeddings.LayerNorm": "norm",
        "attention.self.": "", "attention.output.dense": "merge",
        "attention.output.LayerNorm": "norm1", "intermediate.dense": "up",
        "output.dense": "down", "output.LayerNorm": "norm2", "encoder.layer.": "layers.",
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


class TextEncoder:
    """The exported tower as a function from strings to unit vectors.

    Vectors are kept in memory, and with `cache` also in that file from run to run.
    """

    def __init__(self, folder, cache=None):
        self.tokenizer = Tokenizer.from_file(str(Path(folder) / "tokenizer.json"))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 2
        path = str(Path(folder) / "text.onnx")
        self.session = onnxruntime.InferenceSession(path, options)
        self.cache = cache
        self.known = {}
        if cache and Path(cache).exists():
            with np.load(cache) as kept:
                self.known = dict(zip(kept["names"].tolist(), kept["vectors"]))

    def tokens(self, text):
        ids = np.array([self.tokenizer.encode(text).ids[:MAX_TOKENS]], np.int64)
        return dict(zip(INPUTS, (ids, np.ones_like(ids), np.zeros_like(ids))))

    def __call__(self, texts):
        fresh = [text for text in dict.fromkeys(texts) if text not in self.known]
        for text in fresh:
            self.known[text] = self.session.run(None, self.tokens(text))[0][0]
        if fresh and self.cache:
            names, vectors = list(self.known), np.stack(list(self.known.values()))
            np.savez(self.cache, names=names, vectors=vectors)
        return np.stack([self.known[text] for text in texts])


def embed(tower, tokenizer, texts, batch=64):
    """The fp32 tower on a list of strings."""
    rows = []
    for start in range(0, len(texts), batch):
        ids = [tokenizer.encode(text).ids for text in texts[start:start + batch]]
        mask = torch.zeros(len(ids), max(map(len, ids)), dtype=torch.int64)
        padded = mask.clone()
        for row, tokens in enumerate(ids):
            mask[row, :len(tokens)] = 1
            padded[row, :len(tokens)] = torch.tensor(tokens)
        with torch.inference_mode():
            rows.append(tower(padded, mask, torch.zeros_like(mask)))
    return torch.cat(rows)


def write_tokenizer(source, target):
    """The tokenizer without padding and with truncation at MAX_TOKENS."""
    tokenizer = Tokenizer.from_file(str(source))
    tokenizer.no_padding()
    tokenizer.enable_truncation(MAX_TOKENS)
    tokenizer.save(str(target))
    return tokenizer


def export(tower, path):
    """Write the fp32 graph with a dynamic number of tokens."""
    example = tuple(torch.ones(1, 6, dtype=torch.int64) for _ in INPUTS)
    torch.onnx.export(
        tower, example, str(path), input_names=INPUTS, output_names=["embedding"],
        dynamic_axes={name: {1: "tokens"} for name in INPUTS}, opset_version=17, dynamo=False,
    )


def quantise(source, target):
    """Store the large weights as int8 with one scale per output column; activations stay fp32.

    An embedding table is gathered as int8 and scaled afterwards; a matrix is scaled before use.
    """
    model = onnx.load(source)
    graph = model.graph
    nodes = []
    large = {w.name: w for w in graph.initializer if len(w.dims) == 2 and np.prod(w.dims) > 10_000}
    for node in graph.node:
        used = [name for name in node.input if name in large]
        if not used:
            nodes.append(node)
            continue
        (name,) = used
        weight = numpy_helper.to_array(large[name])
        scale = np.abs(weight).max(0).clip(1e-8) / 127
        graph.initializer.remove(large[name])
        graph.initializer.extend([
            numpy_helper.from_array((weight / scale).round().astype(np.int8), name + ".int8"),
            numpy_helper.from_array(scale.astype(np.float32), name + ".scale"),
            numpy_helper.from_array(np.zeros(len(scale), np.int8), name + ".zero"),
        ])
        parameters = [name + ".scale", name + ".zero"]
        if node.op_type == "Gather":
            result, raw = node.output[0], node.output[0] + ".int8"
            node.input[0], node.output[0] = name + ".int8", raw
            scaling = helper.make_node("DequantizeLinear", [raw, *parameters], [result], axis=-1)
            nodes += [node, scaling]
        else:
            inputs = [name + ".int8", *parameters]
            nodes += [helper.make_node("DequantizeLinear", inputs, [name], axis=1), node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    onnx.save(model, target)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, required=True, help="folder of the sentence encoder")
    parser.add_argument("--vocabulary", type=Path, required=True, help="nouns.json")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    args = parser.parse_args()
    started = time.time()
    args.out.mkdir(parents=True, exist_ok=True)
    tokenizer = write_tokenizer(args.model / "tokenizer.json", args.out / "tokenizer.json")
    tower = load_tower(args.model)
    nouns = [row["name"] for row in json.loads(args.vocabulary.read_text())]
    tower.centre.copy_(embed(tower, tokenizer, nouns).mean(0))
    export(tower, args.out / "text.fp32.onnx")
    quantise(args.out / "text.fp32.onnx", args.out / "text.onnx")
    (args.out / "text.fp32.onnx").unlink()
    texts = nouns[::10] + ["object", "things", "stuff", "texture", "where is the coffee cup?"]
    full, quantised = embed(tower, tokenizer, texts).numpy(), TextEncoder(args.out)(texts)
    cosine = (full * quantised).sum(1)
    between = np.abs(quantised @ quantised.T)[np.triu_indices(len(texts), 1)]
    print(f"int8 against fp32 cosine: mean {cosine.mean():.4f} least {cosine.min():.4f}; "
          f"|cosine| between nouns: median {np.median(between):.3f}; {time.time() - started:.0f} s")


if __name__ == "__main__":
    main()
