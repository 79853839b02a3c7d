"""Triangles with textures: parts, boxes, cylinders, and textures drawn at random.

In:  a random generator, photographs for patches, the textures of a house (arrays [k, k, 3]).
Out: `Part`s (points in metres, z up) whose faces name textures of a `Textures`.
"""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

COLOR = -1  # the texture of a face that carries its own color


class Part:
    """Triangles of one thing: points [P, 3], faces [F, 3], uv [F, 3, 2], texture [F], color."""

    def __init__(self, points, faces, uv, texture, color=None):
        self.points, self.faces, self.uv = points, faces, uv
        self.texture = np.broadcast_to(texture, len(faces))
        self.color = np.zeros((len(faces), 3)) if color is None else color

    def moved(self, turn=0.0, shift=(0, 0, 0), scale=1.0):
        c, s = np.cos(turn), np.sin(turn)
        points = self.points * scale @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + shift
        return Part(points, self.faces, self.uv, self.texture, self.color)


def merge(parts):
    """One part of several."""
    starts = np.cumsum([0] + [len(p.points) for p in parts])
    return Part(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.faces + k for p, k in zip(parts, starts)]),
        np.concatenate([p.uv for p in parts]),
        np.concatenate([p.texture for p in parts]),
        np.concatenate([p.color for p in parts]),
    )


def box(x, y, z, texture, scale=1.0):
    """An axis-aligned box; x, y, z are (from, to); the texture repeats every `scale` metres."""
    corner = np.array([[a, b, c] for a in x for b in y for c in z], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces, uv = [], []
    for side, quad in enumerate(quads):
        axes = [(1, 2), (0, 2), (0, 1)][side // 2]
        for triangle in (quad[:3], (quad[0], quad[2], quad[3])):
            faces.append(triangle)
            uv.append(corner[list(triangle)][:, axes] / scale)
    return Part(corner, np.array(faces), np.array(uv), texture)


def image_box(x, y, z, frame, picture):
    """A flat box whose front (+y) shows a whole picture."""
    part = box(x, y, z, frame)
    textures = part.texture.copy()
    front = slice(6, 8)
    textures[front] = picture
    corners = part.points[part.faces[front]]
    low, high = part.points.min(0), part.points.max(0)
    part.uv[front] = ((corners - low) / (high - low))[..., [0, 2]] * 0.98 + 0.01
    return Part(part.points, part.faces, part.uv, textures)


def cylinder(radius, z, texture, top=None, at=(0, 0), sides=14):
    """An upright (truncated) cone."""
    mesh = trimesh.creation.cylinder(radius, 1.0, sections=sides)
    points = mesh.vertices.copy()
    if top is not None:
        points[points[:, 2] > 0, :2] *= top / radius
    points[:, 2] = (points[:, 2] + 0.5) * (z[1] - z[0]) + z[0]
    points[:, :2] += at
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    uv = np.stack([angle / np.pi, points[:, 2] * 2], -1)[mesh.faces]
    return Part(points, mesh.faces, uv, texture)


class Textures:
    """Texture images [k, k, 3]: plain, wood, cloth, patches of photographs, the house's own."""

    def __init__(self, photos, house, random):
        self.images, self.random = list(house), random
        self.house = len(house)
        self.photos = sorted(Path(photos).glob("*.jpg"))

    def add(self, image):
        self.images.append(np.clip(image, 0, 255).astype(np.float32))
        return len(self.images) - 1

    def tone(self):
        """A color as rooms have them: mostly pale, brown, grey; sometimes anything."""
        r = self.random
        grey = r.uniform(30, 245) if r.random() < 0.6 else r.uniform(170, 245)
        spread = r.choice([8, 25, 90], p=[0.55, 0.35, 0.1])
        return np.clip(
            grey + r.normal(0, spread, 3) + np.array([1, 0.3, -0.8]) * r.uniform(0, 30), 5, 250
        )

    def noise(self, height, width):
        small = self.random.normal(0, 1, (height, width)).astype(np.float32)
        return np.asarray(Image.fromarray(small).resize((96, 96), Image.Resampling.BICUBIC))[
            ..., None
        ]

    def plain(self):
        return self.add(
            self.tone() + self.noise(5, 5) * self.random.uniform(0, 7) + self.noise(64, 64) * 2
        )

    def wood(self):
        base = (
            self.tone()
            if self.random.random() < 0.3
            else (
                np.array([150, 105, 65]) * self.random.uniform(0.3, 1.5)
                + self.random.normal(0, 10, 3)
            )
        )
        shape = (40, 3) if self.random.random() < 0.5 else (3, 40)
        return self.add(base + self.noise(*shape) * base.mean() * self.random.uniform(0.03, 0.15))

    def cloth(self):
        r = self.random
        if r.random() < 0.35:
            return self.photo()
        x, y = np.meshgrid(np.arange(96), np.arange(96))
        a, b, period = self.tone(), self.tone(), r.choice([8, 12, 24, 48])
        stripes = (x // (period // 2) % 2).astype(float)
        if r.random() < 0.4:
            stripes = (stripes + y // (period // 2) % 2) / 2
        if r.random() < 0.4:
            stripes *= 0
        return self.add(a + (b - a) * stripes[..., None] + self.noise(24, 24) * 5)

    def photo(self):
        """A patch of a photograph, now and then almost all of it."""
        r, picture = self.random, Image.open(self.photos[self.random.integers(len(self.photos))])
        side = int(min(picture.size) * r.choice([0.3, 0.6, 0.98]))
        x, y = (int(r.integers(0, s - side + 1)) for s in picture.size)
        crop = picture.convert("RGB").crop((x, y, x + side, y + side)).resize((96, 96))
        return self.add(np.asarray(crop, np.float32))

    def surface(self):
        """Of hard furniture."""
        draw = self.random.random()
        return self.wood() if draw < 0.5 else self.plain() if draw < 0.85 else self.any()

    def any(self):
        if self.house and self.random.random() < 0.6:
            return int(self.random.integers(self.house))
        return self.photo()
