"""Textures drawn at random: plain paint, wood, cloth, patches of photographs, a house's own."""

from pathlib import Path

import numpy as np
from PIL import Image

SIDE = 96  # pixels of a drawn texture, along each axis


class Textures:
    """A growing list of texture images, float32 [k, k, 3] in 0..255.

    Methods without arguments draw a texture, append it and return its number.
    """

    def __init__(self, photos, house, random):
        """`photos`: folder of JPEG files; `house`: textures to begin with; `random`: generator."""
        self.images, self.random = list(house), random
        self.house = len(house)
        self.photos = sorted(Path(photos).glob("*.jpg"))

    def add(self, image):
        """Appends an image and returns its number."""
        self.images.append(np.clip(image, 0, 255).astype(np.float32))
        return len(self.images) - 1

    def tone(self):
        """A color as rooms have them: mostly pale, brown or grey, sometimes any."""
        r = self.random
        grey = r.uniform(30, 245) if r.random() < 0.6 else r.uniform(170, 245)
        spread = r.choice([8, 25, 90], p=[0.55, 0.35, 0.1])
        warm = np.array([1, 0.3, -0.8])
        return np.clip(grey + r.normal(0, spread, 3) + warm * r.uniform(0, 30), 5, 250)

    def noise(self, height, width):
        """Normal noise of height x width cells, enlarged to a texture: [SIDE, SIDE, 1]."""
        small = self.random.normal(0, 1, (height, width)).astype(np.float32)
        large = Image.fromarray(small).resize((SIDE, SIDE), Image.Resampling.BICUBIC)
        return np.asarray(large)[..., None]

    def plain(self):
        """Paint or plastic: one color with slight noise."""
        tone = self.tone()
        coarse = self.noise(5, 5) * self.random.uniform(0, 7)
        return self.add(tone + coarse + self.noise(64, 64) * 2)

    def wood(self):
        """Noise stretched along the grain on a brown or any other color."""
        r = self.random
        if r.random() < 0.3:
            base = self.tone()
        else:
            base = np.array([150, 105, 65]) * r.uniform(0.3, 1.5) + r.normal(0, 10, 3)
        shape = (40, 3) if r.random() < 0.5 else (3, 40)
        return self.add(base + self.noise(*shape) * base.mean() * r.uniform(0.03, 0.15))

    def cloth(self):
        """Stripes, checks, one color, or a patch of a photograph."""
        r = self.random
        if r.random() < 0.35:
            return self.photo()
        x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
        a, b, period = self.tone(), self.tone(), r.choice([8, 12, 24, 48])
        stripes = (x // (period // 2) % 2).astype(float)
        if r.random() < 0.4:
            stripes = (stripes + y // (period // 2) % 2) / 2
        if r.random() < 0.4:
            stripes *= 0
        return self.add(a + (b - a) * stripes[..., None] + self.noise(24, 24) * 5)

    def photo(self):
        """A square patch of a photograph: 30, 60 or 98 % of its shorter side."""
        r, picture = self.random, Image.open(self.photos[self.random.integers(len(self.photos))])
        side = int(min(picture.size) * r.choice([0.3, 0.6, 0.98]))
        x, y = (int(r.integers(0, s - side + 1)) for s in picture.size)
        crop = picture.convert("RGB").crop((x, y, x + side, y + side)).resize((SIDE, SIDE))
        return self.add(np.asarray(crop, np.float32))

    def surface(self):
        """A texture for hard furniture: wood, plain, or any."""
        draw = self.random.random()
        return self.wood() if draw < 0.5 else self.plain() if draw < 0.85 else self.any()

    def any(self):
        """One of the house's textures, or a patch of a photograph."""
        if self.house and self.random.random() < 0.6:
            return int(self.random.integers(self.house))
        return self.photo()
