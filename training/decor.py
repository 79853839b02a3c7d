"""What hangs on walls and what lies on tables, built of boxes and cylinders.

In:  a word and a `Textures` with its random generator (`shapes.py`).
Out: `hanging`: (part, width), its back at y = 0, x centred, z above the floor; `desktop`: a part
     whose foot is at z = 0, centred. Metres.
"""

import numpy as np

from shapes import Part, box, cylinder, image_box, merge


def span(width):
    """Centred on 0."""
    return -width / 2, width / 2


class Decor:
    """One method per word; words with a space are methods with an underscore."""

    def __init__(self, textures):
        self.t, self.r = textures, textures.random

    def hanging(self, word):
        """(part, width) of a thing on the wall."""
        return getattr(self, "wall_" + word.replace(" ", "_"))()

    def desktop(self, word):
        """A part that stands on a surface."""
        return getattr(self, word.replace(" ", "_"))()

    def grey(self, low, high, fine, depth):
        """A texture of one grey."""
        tone = np.full((96, 96, 3), self.r.uniform(low, high))
        return self.t.add(tone + self.t.noise(fine, fine) * depth)

    def keys(self, base, rise, side):
        """A chequered texture."""
        checks = (np.indices((96, 96)) // side % 2).sum(0) % 2
        return self.t.add(np.full((96, 96, 3), base) + rise * checks[..., None])

    def wall_door(self):
        r, t = self.r, self.t
        w, h = r.uniform(0.75, 1.0), r.uniform(1.95, 2.15)
        frame, leaf = t.surface(), t.surface()
        parts = [box(span(w + 0.16), (0, 0.03), (0, h + 0.08), frame),
                 box(span(w), (0, 0.045), (0, h), leaf)]
        if r.random() < 0.6:
            parts += [box(span(w - 0.24), (0.045, 0.06), height, leaf)
                      for height in ((0.2, h * 0.42), (h * 0.5, h - 0.15))]
        handle = (w / 2 - 0.15, w / 2 - 0.04)
        parts.append(box(handle, (0.05, 0.1), (1.0, 1.04), t.plain()))
        return merge(parts), w + 0.2

    def wall_window(self):
        r, t = self.r, self.t
        w, low, high = r.uniform(0.8, 2.2), r.uniform(0.5, 1.1), r.uniform(1.9, 2.3)
        frame = t.plain()
        if r.random() < 0.5:
            sky = t.photo()
        else:
            sky = t.add(np.array([190, 215, 240]) * r.uniform(0.7, 1.08) + t.noise(4, 4) * 10)
        parts = [image_box(span(w), (0, 0.02), (low, high), frame, sky)]
        parts += [box((x - 0.03, x + 0.03), (0, 0.06), (low, high), frame)
                  for x in np.linspace(-w / 2, w / 2, int(r.integers(2, 5)))]
        parts += [box(span(w), (0, 0.06), (z - 0.03, z + 0.03), frame)
                  for z in (low, high, (low + high) / 2)]
        return merge(parts), w

    def wall_curtain(self):
        r, t = self.r, self.t
        w, high, low = r.uniform(0.4, 1.4), r.uniform(2.0, 2.3), r.choice([0.02, 0.7])
        cloth, n = t.cloth() if r.random() < 0.5 else t.plain(), 40
        x = np.linspace(-w / 2, w / 2, n)
        y = 0.1 + 0.035 * np.sin(x * r.uniform(25, 60))
        points = np.concatenate([np.stack([x, y, np.full(n, z)], -1) for z in (low, high)])
        k = np.arange(n - 1)
        faces = np.concatenate([np.stack([k, k + 1, k + n], -1),
                                np.stack([k + 1, k + n + 1, k + n], -1)])
        return Part(points, faces, points[faces][..., [0, 2]], cloth), w

    def wall_air_conditioner(self):
        r = self.r
        w, h, z = r.uniform(0.7, 1.0), r.uniform(0.25, 0.33), r.uniform(1.85, 2.1)
        body = self.grey(190, 245, 5, 3)
        case = box(span(w), (0, r.uniform(0.15, 0.25)), (z, z + h), body)
        slot = box(span(w - 0.1), (0, 0.26), (z + 0.02, z + 0.05), self.t.plain())
        return merge([case, slot]), w

    def wall_tv_screen(self):
        r = self.r
        w = r.uniform(0.7, 1.4)
        z, h, dark = r.uniform(0.7, 1.2), w * 0.58, self.grey(8, 45, 3, 6)
        shown = dark if r.random() < 0.6 else self.t.photo()
        return image_box(span(w), (0.03, 0.08), (z, z + h), dark, shown), w

    def wall_picture(self):
        w, h, z = (self.r.uniform(*ends) for ends in ((0.25, 0.9), (0.25, 0.9), (1.2, 1.5)))
        return self.framed(w, h, z)

    def wall_clock(self):
        _, _, z = (self.r.uniform(*ends) for ends in ((0.25, 0.9), (0.25, 0.9), (1.2, 1.5)))
        side = self.r.uniform(0.2, 0.35)
        return self.framed(side, side, z)

    def framed(self, w, h, z):
        return image_box(span(w), (0, 0.03), (z, z + h), self.t.surface(), self.t.photo()), w

    def laptop(self):
        t = self.t
        body, shown = t.plain(), t.photo() if self.r.random() < 0.6 else t.plain()
        lid = image_box(span(0.34), (-0.13, -0.115), (0.01, 0.23), body, shown)
        keys = box(span(0.3), (-0.08, 0.04), (0.015, 0.017), self.keys(60.0, 50, 6), 0.2)
        return merge([box(span(0.34), (-0.12, 0.12), (0, 0.015), body), keys, lid])

    def monitor(self):
        w, dark = self.r.uniform(0.4, 0.65), self.grey(8, 60, 3, 5)
        low = self.r.uniform(0.08, 0.16)
        shown = dark if self.r.random() < 0.4 else self.t.photo()
        face = image_box(span(w), (-0.02, 0.02), (low, low + w * 0.6), dark, shown)
        return merge([face, box(span(0.06), (-0.05, -0.02), (0, low + 0.1), dark),
                      box(span(0.24), (-0.1, 0.08), (0, 0.015), dark)])

    def screen(self):
        return self.monitor()

    def computer_keyboard(self):
        keys = self.keys(self.r.choice([25, 210]), 30, 8)
        return box(span(0.42), span(0.14), (0, 0.02), keys, 0.25)

    def book(self):
        r, parts, z = self.r, [], 0.0
        for _ in range(r.integers(1, 5)):
            w, d, h = r.uniform(0.12, 0.2), r.uniform(0.18, 0.27), r.uniform(0.008, 0.04)
            cover = self.t.photo() if r.random() < 0.7 else self.t.plain()
            parts.append(box(span(w), span(d), (z, z + h), cover, 0.25).moved(r.uniform(-0.4, 0.4)))
            z += h
        return merge(parts)

    def lamp(self):
        r, metal = self.r, self.t.plain()
        h = r.uniform(0.25, 0.5)
        stand = [cylinder(0.07, (0, 0.02), metal), cylinder(r.uniform(0.01, 0.05), (0, h), metal)]
        shade = self.t.plain()
        return merge([*stand, cylinder(0.13, (h - 0.05, h + 0.13), shade, r.uniform(0.06, 0.13))])

    def vase(self):
        a = self.r.uniform(0.04, 0.1)
        return merge([cylinder(a, (0, a * 2), self.t.any(), a * 1.3),
                      cylinder(a * 1.3, (a * 2, a * 4), self.t.any(), a * 0.6)])

    def mug(self):
        cup = self.t.plain() if self.r.random() < 0.7 else self.t.photo()
        handle = [((0.04, 0.065), (0.02, 0.03)), ((0.04, 0.065), (0.065, 0.075)),
                  ((0.058, 0.066), (0.02, 0.075))]
        return merge([cylinder(0.04, (0, 0.09), cup),
                      *(box(x, (-0.007, 0.007), z, cup) for x, z in handle)])

    def bottle(self):
        glass = self.t.plain()
        neck = cylinder(0.035, (0.18, 0.23), glass, 0.013)
        return merge([cylinder(0.035, (0, 0.18), glass), neck,
                      cylinder(0.014, (0.23, 0.26), self.t.plain())])

    def cardboard_box(self):
        w, d, h = self.r.uniform(0.15, 0.4, 3)
        return box(span(w), span(d), (0, h), self.t.wood(), 0.7)

    def photo_frame(self):
        return image_box(span(0.16), span(0.02), (0, 0.2), self.t.surface(), self.t.photo())
