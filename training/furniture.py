"""What stands on the floor, built of boxes and cylinders in many proportions.

In:  a `Textures` with its random generator (`shapes.py`).
Out: each method of `Kit` returns (word, part, height of its top or None, width, depth), and a
     bookcase what is in it. `furnish.py` puts them into rooms.
"""

import numpy as np
import trimesh

from shapes import Part, box, cylinder, merge


class Kit:
    """Furniture; metres.

    Local axes: x along the wall, y away from it (the back is at y = 0), z up; x is centred.
    """

    def __init__(self, textures):
        self.t, self.r = textures, textures.random

    def legs(self, w, d, h, texture, thick=0.03):
        x, y = w / 2 - thick, d - thick
        return [
            box((a - thick, a + thick), (b - thick, b + thick), (0, h), texture)
            for a in (-x, x)
            for b in (thick, y)
        ]

    def slab(self, w, d, h, texture, thick=0.03):
        return [box((-w / 2, w / 2), (0, d), (h - thick, h), texture)]

    def fronts(self, w, d, z, texture, columns, rows):
        """Doors or drawers with handles on the front."""
        parts, r = [], self.r
        handle = self.t.plain()
        round_handle, gap = r.random() < 0.5, r.uniform(0.005, 0.02)
        for i in range(columns):
            for j in range(rows):
                x = np.array([i, i + 1]) * w / columns - w / 2
                low = z[0] + (z[1] - z[0]) * j / rows
                high = z[0] + (z[1] - z[0]) * (j + 1) / rows
                parts.append(
                    box((x[0] + gap, x[1] - gap), (d, d + 0.02), (low + gap, high - gap), texture)
                )
                middle, half = x.mean(), 0.015 if round_handle else min(0.08, w / columns / 4)
                if columns > 1 and rows == 1:
                    middle = x[1 - i % 2] + (0.05 if i % 2 else -0.05)
                    parts.append(
                        box(
                            (middle - 0.012, middle + 0.012),
                            (d + 0.02, d + 0.045),
                            ((low + high) / 2 - half, (low + high) / 2 + half),
                            handle,
                        )
                    )
                else:
                    centre = (low + high) / 2
                    parts.append(
                        box(
                            (middle - half, middle + half),
                            (d + 0.02, d + 0.045),
                            (centre - 0.012, centre + 0.012),
                            handle,
                        )
                    )
        return parts

    def bed(self):
        r = self.r
        w, length, h = r.uniform(0.9, 2.0), r.uniform(1.9, 2.2), r.uniform(0.3, 0.6)
        frame, sheet, blanket = self.t.surface(), self.t.plain(), self.t.cloth()
        base = r.uniform(0.12, 0.3)
        parts = [
            box((-w / 2, w / 2), (0.05, length), (r.choice([0.0, 0.12]), base), frame),
            box((-w / 2 + 0.03, w / 2 - 0.03), (0.07, length - 0.03), (base, h), sheet),
        ]
        start, drop = r.uniform(0.3, 0.9), r.uniform(0.02, h - 0.1)
        if r.random() < 0.85:
            parts.append(
                box(
                    (-w / 2 - 0.01, w / 2 + 0.01),
                    (start, length + 0.01),
                    (h - drop, h + r.uniform(0.02, 0.07)),
                    blanket,
                )
            )
            if r.random() < 0.5:
                fold = self.t.cloth()
                parts.append(
                    box(
                        (-w / 2 - 0.015, w / 2 + 0.015),
                        (start, start + 0.25),
                        (h - drop, h + 0.075),
                        fold,
                    )
                )
        if r.random() < 0.85:
            high = h + r.uniform(0.15, 0.8)
            parts.append(
                box(
                    (-w / 2 - 0.03, w / 2 + 0.03),
                    (0, r.uniform(0.04, 0.12)),
                    (0, high),
                    frame if r.random() < 0.6 else self.t.cloth(),
                )
            )
            if r.random() < 0.3:
                parts.append(
                    box(
                        (-w / 2 - 0.03, w / 2 + 0.03),
                        (length, length + 0.05),
                        (0, h + r.uniform(0.0, 0.2)),
                        frame,
                    )
                )
        pillow = self.t.cloth() if r.random() < 0.5 else sheet
        for x in [0] if w < 1.3 else [-w / 4, w / 4]:
            shape = trimesh.creation.icosphere(2)
            size = np.array([min(0.36, w / 4.2), 0.22, 0.09])
            points = np.sign(shape.vertices) * np.abs(shape.vertices) ** 0.6 * size + [
                x,
                0.36,
                h + 0.07,
            ]
            parts.append(Part(points, shape.faces, points[shape.faces][..., :2] / 0.6, pillow))
        return "bed", merge(parts), None, w + 0.1, length + 0.05

    def drawers(self, word, w, d, h, columns, rows):
        body = self.t.surface()
        front = body if self.r.random() < 0.6 else self.t.surface()
        foot = self.r.choice([0.0, 0.05, 0.15])
        parts = [box((-w / 2, w / 2), (0, d), (foot, h), body)] + self.fronts(
            w, d, (foot + 0.02, h - 0.03), front, columns, rows
        )
        if foot:
            parts += self.legs(w, d, foot, body, 0.02)
        return word, merge(parts), h, w, d + 0.05

    def nightstand(self):
        r = self.r
        return self.drawers(
            "nightstand",
            r.uniform(0.35, 0.6),
            r.uniform(0.32, 0.45),
            r.uniform(0.4, 0.65),
            1,
            int(r.integers(1, 4)),
        )

    def cabinet(self):
        r = self.r
        word, part, _, w, d = self.drawers(
            "cabinet",
            r.uniform(0.7, 1.8),
            r.uniform(0.35, 0.55),
            r.uniform(0.7, 1.2),
            int(r.integers(2, 5)),
            int(r.integers(1, 4)),
        )
        return word, part, part.points[:, 2].max(), w, d

    def wardrobe(self):
        r = self.r
        return (
            *self.drawers(
                "wardrobe",
                r.uniform(0.8, 2.0),
                r.uniform(0.5, 0.65),
                r.uniform(1.8, 2.25),
                int(r.integers(2, 5)),
                1,
            )[:2],
            None,
            2.0,
            0.65,
        )

    def refrigerator(self):
        r, w = self.r, self.r.uniform(0.55, 0.95)
        h, d, body = r.uniform(1.5, 2.0), 0.65, self.t.plain()
        parts = [box((-w / 2, w / 2), (0, d), (0.03, h), body)] + self.fronts(
            w, d, (0.05, h), body, int(r.integers(1, 3)), int(r.integers(1, 3))
        )
        return "refrigerator", merge(parts), None, w, 0.7

    def tv_cabinet(self):
        r = self.r
        return self.drawers(
            "tv cabinet",
            r.uniform(1.2, 2.0),
            r.uniform(0.35, 0.45),
            r.uniform(0.3, 0.55),
            int(r.integers(2, 4)),
            int(r.integers(1, 3)),
        )

    def table(self, word="table"):
        r = self.r
        w, d, h = r.uniform(0.9, 1.7), r.uniform(0.6, 0.95), r.uniform(0.68, 0.8)
        if word == "coffee table":
            h = r.uniform(0.32, 0.48)
        top = self.t.surface()
        leg = top if r.random() < 0.5 else self.t.surface()
        if r.random() < 0.2:
            parts = [
                cylinder(0.45, (h - 0.03, h), top, at=(0, 0.45), sides=24),
                cylinder(0.05, (0, h), leg, at=(0, 0.45)),
                cylinder(0.25, (0, 0.03), leg, at=(0, 0.45)),
            ]
            return word, merge(parts), h, 0.6, 0.6
        parts = self.slab(w, d, h, top, r.uniform(0.02, 0.06)) + self.legs(
            w, d, h, leg, r.uniform(0.015, 0.045)
        )
        return word, merge(parts), h, w, d

    def coffee_table(self):
        return self.table("coffee table")

    def desk(self):
        r = self.r
        w, d, h, top = (
            r.uniform(1.0, 1.6),
            r.uniform(0.5, 0.75),
            r.uniform(0.7, 0.78),
            self.t.surface(),
        )
        parts = self.slab(w, d, h, top)
        if r.random() < 0.7:
            block = self.drawers("", 0.4, d - 0.08, h - 0.04, 1, 3)[1].moved(
                shift=(w / 2 - 0.22, 0, 0)
            )
            parts += [block, box((-w / 2, -w / 2 + 0.03), (0, d), (0, h), top)]
        else:
            parts += self.legs(w, d, h, top)
        return "desk", merge(parts), h, w, d

    def chair(self, word="chair"):
        r = self.r
        w, d, h = r.uniform(0.38, 0.52), r.uniform(0.4, 0.5), r.uniform(0.42, 0.5)
        frame, seat = self.t.surface(), self.t.cloth() if r.random() < 0.5 else self.t.surface()
        parts = self.slab(w, d, h, seat, r.uniform(0.03, 0.09))
        if r.random() < 0.25:  # on a column with a star foot
            parts += [cylinder(0.03, (0.05, h), frame, at=(0, d / 2))]
            for a in np.arange(5) * 2 * np.pi / 5:
                parts.append(
                    box((0, 0.28), (-0.02, 0.02), (0.03, 0.07), frame).moved(a, (0, d / 2, 0))
                )
        else:
            parts += self.legs(w, d, h, frame, r.uniform(0.012, 0.025))
        if word == "chair":
            back = h + r.uniform(0.3, 0.6)
            if r.random() < 0.5:
                parts.append(box((-w / 2, w / 2), (0, 0.04), (h + r.choice([0, 0.15]), back), seat))
            else:
                bars = int(r.integers(2, 6))
                parts += [
                    box((x - 0.015, x + 0.015), (0, 0.03), (h, back), frame)
                    for x in np.linspace(-w / 2 + 0.02, w / 2 - 0.02, bars)
                ]
                parts.append(box((-w / 2, w / 2), (0, 0.03), (back - 0.08, back), frame))
            if r.random() < 0.3:
                parts += [
                    box((x - 0.02, x + 0.02), (0, d), (h + 0.2, h + 0.23), frame)
                    for x in (-w / 2, w / 2)
                ]
        return word, merge(parts), None, w, d

    def stool(self):
        return self.chair("stool")

    def sofa(self):
        r = self.r
        w, d, h = r.uniform(1.2, 2.4), r.uniform(0.75, 1.0), r.uniform(0.36, 0.48)
        cloth = self.t.cloth() if r.random() < 0.6 else self.t.plain()
        arm, back = r.uniform(0.1, 0.25), r.uniform(0.65, 0.95)
        parts = [
            box((-w / 2, w / 2), (0, d), (r.choice([0.02, 0.1]), h - 0.12), cloth),
            box((-w / 2, w / 2), (0, r.uniform(0.15, 0.28)), (0.1, back), cloth),
        ]
        count = max(1, int((w - 2 * arm) / 0.7))
        edges = np.linspace(-w / 2 + arm, w / 2 - arm, count + 1)
        seat = cloth if r.random() < 0.8 else self.t.cloth()
        for a, b in zip(edges, edges[1:]):
            parts += [
                box((a + 0.01, b - 0.01), (0.2, d), (h - 0.12, h), seat),
                box((a + 0.01, b - 0.01), (0.2, 0.36), (h, back + 0.05), seat),
            ]
        high = h + r.uniform(0.08, 0.25)
        parts += [
            box((-w / 2, -w / 2 + arm), (0, d), (0.05, high), cloth),
            box((w / 2 - arm, w / 2), (0, d), (0.05, high), cloth),
        ]
        return "sofa", merge(parts), None, w, d

    def books(self, x, y, z):
        """A row of books from x[0] to x[1], on a board at z, backs towards +y."""
        parts, at = [], x[0]
        while True:
            w, h, d = (
                self.r.uniform(0.015, 0.05),
                self.r.uniform(0.16, 0.27),
                self.r.uniform(0.12, 0.2),
            )
            if at + w > x[1]:
                return parts
            parts.append(
                box(
                    (at, at + w),
                    (y - d, y),
                    (z, z + h),
                    self.t.photo() if self.r.random() < 0.25 else self.t.plain(),
                    0.15,
                )
            )
            at += w + self.r.choice([0.001, 0.001, 0.06])

    def bookcase(self):
        r = self.r
        w, d, h, body = (
            r.uniform(0.6, 1.5),
            r.uniform(0.26, 0.36),
            r.uniform(1.0, 2.1),
            self.t.surface(),
        )
        parts = [box((x, x + 0.025), (0, d), (0, h), body) for x in (-w / 2, w / 2 - 0.025)]
        parts.append(box((-w / 2, w / 2), (0, 0.01), (0, h), body))
        levels, books = np.linspace(0.05, h, int(h / 0.33) + 1), []
        for z in levels:
            parts.append(box((-w / 2, w / 2), (0, d), (z - 0.02, z), body))
            if r.random() < 0.8 and z < h - 0.1:
                books += self.books((-w / 2 + 0.04, w / 2 - r.uniform(0.04, w / 2)), d - 0.04, z)
        extra = [("book", merge(books))] if books else []
        return "bookcase", merge(parts), None, w, d, extra

    def trash_can(self):
        r = self.r.uniform(0.1, 0.18)
        return (
            "trash can",
            cylinder(r, (0, self.r.uniform(0.25, 0.5)), self.t.plain(), top=r * 1.25, at=(0, 0.2)),
            None,
            0.4,
            0.4,
        )

    def floor_lamp(self):
        h, metal = self.r.uniform(1.3, 1.7), self.t.plain()
        parts = [
            cylinder(0.14, (0, 0.03), metal, at=(0, 0.2)),
            cylinder(0.015, (0, h), metal, at=(0, 0.2)),
            cylinder(
                0.2, (h - 0.1, h + 0.2), self.t.plain(), top=self.r.uniform(0.08, 0.2), at=(0, 0.2)
            ),
        ]
        return "lamp", merge(parts), None, 0.4, 0.4

    def plant(self):
        pot = cylinder(0.13, (0, 0.28), self.t.plain(), top=0.17, at=(0, 0.25))
        green = self.t.add(
            np.array([50, 110, 45]) * self.r.uniform(0.5, 1.5) + self.t.noise(30, 30) * 20
        )
        leaves = []
        for _ in range(40):
            a, b, length = (
                self.r.uniform(0, 2 * np.pi),
                self.r.uniform(0.2, 1.3),
                self.r.uniform(0.25, 0.7),
            )
            leaf = np.array([[0, 0, 0.27], [0.5, 0.12, 0.27], [1, 0, 0.27], [0.5, -0.12, 0.27]]) * [
                length,
                length,
                1,
            ]
            rise = leaf[:, 0].copy()
            leaf[:, 0], leaf[:, 2] = rise * np.cos(b), 0.27 + rise * np.sin(b)
            faces = np.array([[0, 1, 2], [0, 2, 3]])
            leaves.append(Part(leaf, faces, leaf[faces][..., :2], green).moved(a, (0, 0.25, 0)))
        return "potted plant", merge([pot, *leaves]), None, 0.5, 0.5

    # things that hang on walls: (word, part), back at y = 0, x centred, z absolute
