"""Lit screens, prints and framed pictures, pasted into images and their label maps.

A screen has a bezel and emits light: the image's brightness does not change it, it may be
overexposed and shines on its surroundings; some are off. Prints and framed pictures, which networks
mistake for screens, are as bright as the image. All are seen in perspective; some are cut off or
blurred. `pages.py` draws them.
"""

import numpy as np
from PIL import Image, ImageFilter

from ..constants import STRIDE
from .pages import Pages

MARGIN = 16  # pixels around an object that its light may reach
SCREENS = ["screen"] * 9 + ["monitor", "television", "tv screen"] * 3 + ["computer screen"] * 2
LYING = ["book"] * 5 + ["magazine"] * 2 + ["paper"] * 2
HANGING = ["poster"] * 4 + ["picture"] * 3 + ["paper", "book"]


def corners(width, height, yaw, pitch, roll, away=2.5):
    """The corners [4, 2] of a rectangle turned in space, centred on 0.

    It is seen from `away` times its longer side.
    """
    x, y = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]) / 2 * [[width], [height]]
    x, z = x * np.cos(yaw), x * np.sin(yaw)
    y, z = y * np.cos(pitch) - z * np.sin(pitch), y * np.sin(pitch) + z * np.cos(pitch)
    x, y = x * np.cos(roll) - y * np.sin(roll), x * np.sin(roll) + y * np.cos(roll)
    return np.stack([x, y], 1) / (1 + z / (away * max(width, height)))[:, None]


def warp(picture, target, size, method=Image.Resampling.BICUBIC):
    """The picture with its corners at `target` [4, 2], on an empty canvas of `size`."""
    (w, h), rows = picture.size, []
    wanted = [(0, 0), (w, 0), (w, h), (0, h)]
    for (x, y), (u, v) in zip(target, wanted, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    found = np.linalg.solve(rows, np.ravel(wanted))
    return picture.transform(size, Image.Transform.PERSPECTIVE, found, method)


class Screens:
    """Pastes screens and prints. Construction numbers all the words that it labels with."""

    def __init__(self, words, photos, random):
        """`photos` (rgb arrays) are shown by some screens and prints."""
        self.pages, self.random = Pages(photos, random), random
        self.word = {n: words.add(n) for n in sorted({*SCREENS, *LYING, *HANGING, "laptop"})}

    def put(self, image, label):
        """Pastes one to four screens and prints, in place.

        image: uint8 [h, w, 3]; label: word numbers [h / STRIDE, w / STRIDE].
        """
        for _ in range(self.random.integers(1, 5)):
            self.put_one(image, label, self.random.random() < 0.5)

    def put_one(self, image, label, is_screen):
        """Pastes a screen or a print at a random place, in place."""
        r, (rows, columns) = self.random, image.shape[:2]
        lying = not is_screen and r.random() < 0.5
        name = str(r.choice(SCREENS if is_screen else LYING if lying else HANGING))
        *layers, part = self.pages.screen() if is_screen else self.pages.print(name)
        width = columns * (r.uniform(0.1, 0.45) if is_screen else r.uniform(0.06, 0.28))
        small = (int(width) + 2, int(width * part.height / part.width) + 2)
        layers = [layer.resize(small, Image.Resampling.BOX) for layer in layers]
        layers.append(Image.new("L", small, 255))
        target = self.place(small, (rows, columns), lying)
        low = np.maximum((target.min(0) - MARGIN) // STRIDE * STRIDE, 0).astype(int)
        size = (np.minimum(target.max(0) + MARGIN, (columns, rows)) - low).astype(int)
        if min(size) < STRIDE:
            return
        layers = [warp(layer, target - low, tuple(size)) for layer in layers]
        if r.random() < 0.5:
            soft = ImageFilter.GaussianBlur(r.uniform(0.3, 1.6))
            layers = [layer.filter(soft) for layer in layers]
        x, y = low
        self.blend(image[y : y + size[1], x : x + size[0]], layers, image.mean())
        part = warp(part, target - low, tuple(size), Image.Resampling.NEAREST)
        part = np.asarray(part)[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
        under = label[y // STRIDE :, x // STRIDE :][: part.shape[0], : part.shape[1]]
        is_laptop = (part == 2).any() and r.random() < 0.5
        under[part == 1] = self.word["laptop" if is_laptop else name]
        under[part == 2] = self.word["laptop"]

    def place(self, size, within, lying):
        """Corners [4, 2] (x, y) of something of `size` in an image `within` (rows, columns)."""
        r, (rows, columns) = self.random, within
        if lying:
            pitch, roll = r.uniform(0.5, 1.2), r.uniform(-3, 3)
        else:
            pitch, roll = r.normal(0, (0.15, 0.12))
        centre = r.uniform(0, columns), rows * (r.uniform(0.4, 1) if lying else r.beta(1.2, 1.8))
        return corners(*size, r.normal(0, 0.45), pitch, roll) + centre

    def blend(self, under, layers, brightness):
        """Blends (colors, light, alpha) over part of an image with the mean `brightness`."""
        r, shape = self.random, under.shape[:2]
        colors, shine, alpha = (np.asarray(p, np.float32).reshape(*shape, -1) for p in layers)
        shine, alpha = shine / 255, alpha / 255
        ambient = np.clip(brightness / 140 * r.uniform(0.7, 1.3), 0.25, 1.3)
        colors = colors * (ambient * (1 - shine) + r.uniform(0.8, 1.7) * shine)
        glow = Image.fromarray(np.clip(colors * shine, 0, 255).astype(np.uint8))
        glow = np.asarray(glow.filter(ImageFilter.GaussianBlur(r.uniform(1, 8))), np.float32)
        colors += under * (1 - alpha) + glow * max(r.uniform(-0.5, 0.5), 0)
        under[:] = np.clip(colors, 0, 255)
