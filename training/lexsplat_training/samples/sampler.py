"""Random training samples from labelled frames and photographs.

A sample is (image [3, h, w] in 0..255, word [h / STRIDE, w / STRIDE], weight [h / STRIDE,
w / STRIDE]); words are numbers of `Words`, -1 = none; a weight of 0 leaves a pixel out of the loss.
"""

import numpy as np
from PIL import Image

from ..constants import STRIDE
from . import images
from .screens import Screens
from .words import INDOOR, VOC


class Sampler:
    """Crops of frames and of photographs (alone, four as a mosaic, or pasted into frames).

    Drawn screens and prints are pasted into both. All randomness comes from one seed.
    """

    def __init__(self, frames, photos, words, size, seed, photo_share=0.0, screens=0.0):
        """frames: [(weight, [(rgb, words)])]: a frame is drawn in proportion to its weight.

        photos: as `photos.read_photos` yields them. size: (width, height) of a sample.
        photo_share, screens: chances of a photograph, and of screens and prints on a sample.
        """
        self.frames = [frame for _, some in frames for frame in some]
        chance = np.array([weight for weight, some in frames for _ in some], float)
        self.chance = np.cumsum(chance) / chance.sum()
        self.photos, self.words = photos, words
        self.size, self.share, self.random = size, photo_share, np.random.default_rng(seed)
        self.drawn = Screens(words, [photo[0] for photo in photos], self.random)
        self.screens = screens
        self.voc = [words.add(name) if name and photos else -1 for name in VOC]
        likely = np.array([4.0 if words.names[word] in INDOOR else 1.0 for _, word, *_ in photos])
        self.likely = np.cumsum(likely) / likely.sum() if photos else likely

    def draw(self, size):
        """One sample of `size` (width, height): image and weight float32, word int64."""
        photo = self.photos and (not self.frames or self.random.random() < self.share)
        image, word, weight = self.mosaic(size) if photo else self.frame(size)
        return image.transpose(2, 0, 1).astype(np.float32), word, weight.astype(np.float32)

    def crop(self, image, labels, least, size):
        """A random part of an image and its label maps, mirrored by chance, stretched to `size`.

        It has at least 0.85 `least` of the height and of the width.
        """
        width, height = size
        r, (h, w) = self.random, image.shape[:2]
        scale = r.uniform(least, 1.0)
        ch, cw = int(h * scale * r.uniform(0.85, 1.0)), int(w * scale * r.uniform(0.85, 1.0))
        y, x = r.integers(0, h - ch + 1), r.integers(0, w - cw + 1)
        step = -1 if r.random() < 0.5 else 1
        image, *labels = (a[y : y + ch, x : x + cw][:, ::step] for a in (image, *labels))
        grid = width // STRIDE, height // STRIDE
        labels = [np.ascontiguousarray(label) for label in labels]
        small = [images.resize(label, *grid, images.NEAREST) for label in labels]
        return images.resize(np.ascontiguousarray(image), *size, images.BILINEAR), small

    def frame(self, size):
        """A labelled frame. A word's weight falls with the root of its area."""
        image, label = self.frames[np.searchsorted(self.chance, self.random.random())]
        image, (label,) = self.crop(image, [label.astype(np.int32)], 0.45, size)
        image, label = image.copy(), label.copy()
        if self.photos and self.random.random() < 0.3:
            for _ in range(self.random.integers(1, 4)):
                self.paste(image, label)
        if self.random.random() < self.screens:
            self.drawn.put(image, label)
        word, weight = np.full(label.shape, -1, np.int64), np.zeros(label.shape, np.float32)
        for value in np.unique(label[label >= 0]):
            where = label == value
            word[where] = self.words.draw(value, self.random, 0.15)
            weight[where] = 1 / np.sqrt(where.sum())
        return images.photometric(image, self.random), word, weight / max(weight.mean(), 1e-6)

    def paste(self, image, label):
        """Pastes the object of a photograph into a frame, in place."""
        r, (rows, columns) = self.random, label.shape
        side = int(r.uniform(0.2, 0.55) * rows)
        photo, word, _ = self.photo((side * STRIDE, side * STRIDE))
        values, counts = np.unique(word[word >= 0], return_counts=True)
        if not len(values):
            return
        largest = values[counts.argmax()]
        shown = word == largest
        if shown.mean() < 0.05:
            return
        y, x = r.integers(0, rows - side + 1), r.integers(0, columns - side + 1)
        label[y : y + side, x : x + side][shown] = largest
        alpha = Image.fromarray(shown.astype(np.uint8) * 255).resize(photo.shape[1::-1])
        alpha = np.asarray(alpha, np.float32)[..., None] / 255
        rows = slice(y * STRIDE, (y + side) * STRIDE)
        part = image[rows, x * STRIDE : (x + side) * STRIDE]
        part[:] = (photo * alpha + part * (1 - alpha)).astype(np.uint8)

    def photo(self, size):
        """A photograph: its word holds where the activation map is high, VOC's words elsewhere."""
        row = self.photos[np.searchsorted(self.likely, self.random.random())]
        image, own, heat, voc = row
        height, width = image.shape[:2]
        heat = images.resize(heat, width, height, images.BILINEAR)
        voc = images.resize(voc, width, height, images.NEAREST)
        image, (heat, voc) = self.crop(image, [heat, voc], 0.6, size)
        own = self.words.draw(own, self.random, 0.2)
        weight = np.where(heat > 0.5, heat, 0.0).astype(np.float32)
        word = np.where(weight > 0, own, -1).astype(np.int64)
        for value in np.unique(voc[voc > 0]):
            where = voc == value
            if where.mean() < 0.01:
                continue
            mine = heat[where].mean() > 0.5  # this segment is the photograph's own object
            if mine:
                word[word == own] = -1
            word[where] = own if mine and self.random.random() < 0.6 else self.voc[value]
            weight[where] = 0.8
        return image, word, np.where(word >= 0, weight, 0).astype(np.float32)

    def mosaic(self, size):
        """Four photographs side by side, or by chance one alone."""
        width, height = size
        if self.random.random() < 0.4:
            return self.finish(*self.photo(size))
        cut = STRIDE * 4
        x = int(self.random.integers(width // 3, width * 2 // 3)) // cut * cut
        y = int(self.random.integers(height // 3, height * 2 // 3)) // cut * cut
        rows = [[self.photo((w, h)) for w in (x, width - x)] for h in (y, height - y)]
        image, word, weight = (
            np.concatenate([np.concatenate([part[k] for part in row], 1) for row in rows])
            for k in range(3)
        )
        return self.finish(image, word, weight)

    def finish(self, image, word, weight):
        """Pastes screens and prints by chance, then changes the image as cameras do."""
        if self.random.random() < self.screens:
            image, label = image.copy(), np.full(word.shape, -1)
            self.drawn.put(image, label)
            word = np.where(label >= 0, label, word)
            weight = np.where(label >= 0, 0.8, weight)
        return images.photometric(image, self.random), word, weight
