"""A bundle's text tower as a function from strings to vectors."""

from pathlib import Path

import numpy as np
from tokenizers import Tokenizer

from .session import session

MAX_TOKENS = 64  # of models/tiny
INPUTS = ["input_ids", "attention_mask", "token_type_ids"]


class TextEncoder:
    """Strings -> embeddings [n, D] of unit length; each string is computed once."""

    def __init__(self, folder, cache=None, limit=MAX_TOKENS):
        """folder: of text.onnx and tokenizer.json. cache: file that keeps vectors between runs.

        limit: largest number of tokens; further ones are left out.
        """
        self.tokenizer = Tokenizer.from_file(str(Path(folder) / "tokenizer.json"))
        self.tokenizer.enable_truncation(limit)
        self.tokenizer.no_padding()
        self.session = session(Path(folder) / "text.onnx")
        self.cache = cache
        self.known = {}
        if cache and Path(cache).exists():
            with np.load(cache) as kept:
                self.known = dict(zip(kept["names"].tolist(), kept["vectors"], strict=True))

    def tokens(self, text):
        """The graph's inputs for a string; a graph of a fixed length gets zeros behind them."""
        ids = self.tokenizer.encode(text).ids
        declared = self.session.get_inputs()[0].shape[1]
        length = declared if isinstance(declared, int) else len(ids)
        filled = np.zeros((1, length), np.int64)
        filled[0, : len(ids)] = ids
        mask = (np.arange(length) < len(ids)).astype(np.int64)[None]
        values = dict(zip(INPUTS, (filled, mask, np.zeros_like(filled)), strict=True))
        return {given.name: values[given.name] for given in self.session.get_inputs()}

    def __call__(self, texts):
        fresh = [text for text in dict.fromkeys(texts) if text not in self.known]
        for text in fresh:
            self.known[text] = self.session.run(None, self.tokens(text))[0][0]
        if fresh and self.cache:
            names, vectors = list(self.known), np.stack(list(self.known.values()))
            np.savez(self.cache, names=names, vectors=vectors)
        return np.stack([self.known[text] for text in texts])
