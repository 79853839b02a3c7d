"""models/tiny's text tower as a function from strings to vectors."""

from pathlib import Path

import numpy as np
from tokenizers import Tokenizer

from .session import session

MAX_TOKENS = 64
INPUTS = ["input_ids", "attention_mask", "token_type_ids"]


class TextEncoder:
    """Strings -> embeddings [n, D] of unit length; each string is computed once."""

    def __init__(self, folder, cache=None):
        """folder: of text.onnx and tokenizer.json. cache: file that keeps vectors between runs."""
        self.tokenizer = Tokenizer.from_file(str(Path(folder) / "tokenizer.json"))
        self.session = session(Path(folder) / "text.onnx")
        self.cache = cache
        self.known = {}
        if cache and Path(cache).exists():
            with np.load(cache) as kept:
                self.known = dict(zip(kept["names"].tolist(), kept["vectors"], strict=True))

    def tokens(self, text):
        """The graph's inputs for a string."""
        ids = np.array([self.tokenizer.encode(text).ids[:MAX_TOKENS]], np.int64)
        return dict(zip(INPUTS, (ids, np.ones_like(ids), np.zeros_like(ids)), strict=True))

    def __call__(self, texts):
        fresh = [text for text in dict.fromkeys(texts) if text not in self.known]
        for text in fresh:
            self.known[text] = self.session.run(None, self.tokens(text))[0][0]
        if fresh and self.cache:
            names, vectors = list(self.known), np.stack(list(self.known.values()))
            np.savez(self.cache, names=names, vectors=vectors)
        return np.stack([self.known[text] for text in texts])
