"""The loss of the image encoder (paper section 4.1), with two further terms."""

import torch
from torch import nn
from torch.nn import functional as F

from ..networks.layers import rows_at
from ..networks.vectors import unit


class RelevancyLoss(nn.Module):
    """Cross-entropy of the relevancy: does this pixel belong to this word?

    logit = scale (f.q - max f.n) - offset for features f, words q and negatives n; scale and offset
    are learned. Words with a cosine above `near` to the pixel's word count neither way.
    """

    def __init__(self, table, negatives, near=0.62, others=96):
        """table [words, D], negatives [n, D]: embeddings; others: absent words asked per step."""
        super().__init__()
        self.table, self.negatives, self.others = table, negatives, others
        self.alike = table @ table.T > near
        self.scale = nn.Parameter(torch.tensor(9.0))
        self.offset = nn.Parameter(torch.tensor(4.0))

    def forward(self, found, word):
        """found: features [n, D]; word: numbers [n]."""
        present = word.unique()
        count = min(self.others, len(self.table))
        asked = torch.cat([present, torch.randperm(len(self.table))[:count]]).unique()
        against = (found @ self.negatives.T).max(1, keepdim=True).values
        logit = self.scale * (found @ self.table[asked].T - against) - self.offset
        right = word[:, None] == asked
        wrong = ~self.alike[word][:, asked]
        hits = F.softplus(-logit[right]).mean()
        misses = F.softplus(logit) * wrong
        # Absent words are many and easy: the batch's words count as much as all others together.
        inside = torch.isin(asked, present)
        return hits + misses[:, inside].sum(1).mean() + misses[:, ~inside].mean() * 20


class Loss:
    """The paper's loss, a contrastive term and `RelevancyLoss`, on some of the labelled pixels.

    Paper: 0.8 (1 - cos) + L1 + 0.01 total variation, to the embedding of each pixel's word.
    """

    def __init__(self, table, relevancy, random, samples=3000, temperature=0.06):
        """table: embeddings of all words [words, D]; samples: pixels per step."""
        self.table, self.relevancy, self.random = table, relevancy, random
        self.samples, self.temperature = samples, temperature

    def pixels(self, weight):
        """(image, y, x) of pixels drawn in proportion to their weight [b, h, w]."""
        count = min(self.samples, int((weight > 0).sum()))
        flat = torch.multinomial(weight.flatten(), count, generator=self.random)
        _, height, width = weight.shape
        return flat // (height * width), flat // width % height, flat % width

    def term(self, found, word, contrast_weight=0.25):
        """(0.8 (1 - cos) + L1 + contrast to all words, cosine, contrast) of features [n, D]."""
        wanted = self.table[word]
        cosine = (found * wanted).sum(1).mean()
        logits = found @ self.table.T / self.temperature
        alike = self.relevancy.alike[word].scatter(1, word[:, None], False)
        contrast = F.cross_entropy(logits.masked_fill(alike, -1e4), word)
        value = 0.8 * (1 - cosine) + (found - wanted).abs().mean() + contrast_weight * contrast
        return value, cosine.item(), contrast.item()

    def __call__(self, decoder, maps, word, weight):
        """(loss, and its cosine, contrast and relevancy to show); word, weight: [b, h, w]."""
        image, y, x = self.pixels(weight)
        word = word[image, y, x]
        hidden = decoder.hidden(*maps)
        found = decoder.at(hidden, image, y, x)
        value, *shown = self.term(found, word)
        few = slice(0, self.samples // 4)
        right = decoder.at(hidden, image[few], y[few], (x[few] + 1).clamp_max(hidden.shape[3] - 1))
        below = decoder.at(hidden, image[few], (y[few] + 1).clamp_max(hidden.shape[2] - 1), x[few])
        variation = (right - found[few]).abs().mean() + (below - found[few]).abs().mean()
        coarse = unit(rows_at(maps[0], image, y // 4, x // 4), 1)
        relevancy = self.relevancy(found, word)
        value = value + 0.01 * variation + 0.3 * self.term(coarse, word)[0] + 0.25 * relevancy
        return value, *shown, relevancy.item()
