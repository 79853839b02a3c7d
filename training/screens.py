"""Lit screens, and the prints and pictures they are mistaken for, pasted into images.

In:  the words, photographs (rgb arrays, shown by some screens and prints), one random generator.
Out: `put` changes an image [h, w, 3] and its label map [h/4, w/4] in place.

A screen has a bezel and gives light of its own: it ignores the light of the image, may be
overexposed and shines on what is around it; some are off. A print has no bezel, and prints and
framed pictures are as bright as the image. All are seen in perspective, some cut off or blurred.
`pages.py` draws them.
"""

import numpy as np
from PIL import Image, ImageFilter

from pages import Pages

STRIDE, ROOM = 4, 16  # of the label grid; pixels around a thing that its light may reach
SCREENS = ["screen"] * 9 + ["monitor", "television", "tv screen"] * 3 + ["computer screen"] * 2
LYING = ["book"] * 5 + ["magazine"] * 2 + ["paper"] * 2
HANGING = ["poster"] * 4 + ["picture"] * 3 + ["paper", "book"]


def corners(width, height, yaw, pitch, roll, away=2.5):
    """A rectangle turned in space, centred on 0, as seen from `away` times its longer side."""
    x, y = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]) / 2 * [[width], [height]]
    x, z = x * np.cos(yaw), x * np.sin(yaw)
    y, z = y * np.cos(pitch) - z * np.sin(pitch), y * np.sin(pitch) + z * np.cos(pitch)
    x, y = x * np.cos(roll) - y * np.sin(roll), x * np.sin(roll) + y * np.cos(roll)
    return np.stack([x, y], 1) / (1 + z / (away * max(width, height)))[:, None]


def warp(picture, target, size, method=Image.Resampling.BICUBIC):
    """The picture with its corners at `target`, on an empty canvas of (width, height) `size`."""
    (w, h), rows = picture.size, []
    wanted = [(0, 0), (w, 0), (w, h), (0, h)]
    for (x, y), (u, v) in zip(target, wanted):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    found = np.linalg.solve(rows, np.ravel(wanted))
    return picture.transform(size, Image.Transform.PERSPECTIVE, found, method)


class Screens:
    """Pastes screens and prints; all its words are known after construction."""

    def __init__(self, words, photos, random):
        self.pages, self.random = Pages(photos, random), random
        self.word = {n: words.add(n) for n in sorted({*SCREENS, *LYING, *HANGING, "laptop"})}

    def put(self, image, label):
        """One to four screens and prints, in place."""
        for _ in range(self.random.integers(1, 5)):
            self.one(image, label, self.random.random() < 0.5)

    def one(self, image, label, is_screen):
        """A screen or a print somewhere, in place."""
        r, (rows, columns) = self.random, image.shape[:2]
        lying = not is_screen and r.random() < 0.5
        name = str(r.choice(SCREENS if is_screen else LYING if lying else HANGING))
        *drawn, part = self.pages.screen() if is_screen else self.pages.print(name)
        width = columns * (r.uniform(0.1, 0.45) if is_screen else r.uniform(0.06, 0.28))
        small = (int(width) + 2, int(width * part.height / part.width) + 2)
        drawn = [p.resize(small, Image.Resampling.BOX) for p in drawn]
        drawn.append(Image.new("L", small, 255))
        pitch, roll = r.normal(0, (0.15, 0.12)) if not lying else (r.uniform(0.5, 1.2),
                                                                   r.uniform(-3, 3))
        centre = r.uniform(0, columns), rows * (r.uniform(0.4, 1) if lying else r.beta(1.2, 1.8))
        target = corners(*small, r.normal(0, 0.45), pitch, roll) + centre
        x, y = low = np.maximum((target.min(0) - ROOM) // STRIDE * STRIDE, 0).astype(int)
        wide, high = (np.minimum(target.max(0) + ROOM, (columns, rows)) - low).astype(int)
        if min(wide, high) < STRIDE:
            return
        drawn = [warp(p, target - low, (wide, high)) for p in drawn]
        if r.random() < 0.5:
            soft = ImageFilter.GaussianBlur(r.uniform(0.3, 1.6))
            drawn = [p.filter(soft) for p in drawn]
        colors, shine, alpha = (np.asarray(p, np.float32).reshape(high, wide, -1) for p in drawn)
        shine, alpha = shine / 255, alpha / 255
        ambient = np.clip(image.mean() / 140 * r.uniform(0.7, 1.3), 0.25, 1.3)
        colors = colors * (ambient * (1 - shine) + r.uniform(0.8, 1.7) * shine)
        glow = Image.fromarray(np.clip(colors * shine, 0, 255).astype(np.uint8))
        glow = np.asarray(glow.filter(ImageFilter.GaussianBlur(r.uniform(1, 8))), np.float32)
        under = image[y:y + high, x:x + wide]
        colors += under * (1 - alpha) + glow * max(r.uniform(-0.5, 0.5), 0)
        under[:] = np.clip(colors, 0, 255)
        part = warp(part, target - low, (wide, high), Image.Resampling.NEAREST)
        part = np.asarray(part)[STRIDE // 2::STRIDE, STRIDE // 2::STRIDE]
        place = label[y // STRIDE:, x // STRIDE:][:part.shape[0], :part.shape[1]]
        place[part == 1] = self.word["laptop" if (part == 2).any() and r.random() < 0.5 else name]
        place[part == 2] = self.word["laptop"]
