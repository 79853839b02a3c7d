"""Beds, tables, seats, lamps and plants in random proportions, and the table of all furniture.

Every builder takes `Textures` and returns a `Piece`.
"""

import itertools

import numpy as np
import trimesh

from . import storage
from .carpentry import Piece, board, chest, legs
from .part import Part, box, cylinder, merge, span


def bed(textures):
    r = textures.random
    width, length, height = r.uniform(0.9, 2.0), r.uniform(1.9, 2.2), r.uniform(0.3, 0.6)
    frame, sheet, blanket = textures.surface(), textures.plain(), textures.cloth()
    base = r.uniform(0.12, 0.3)
    inner = (-width / 2 + 0.03, width / 2 - 0.03)
    parts = [
        box(span(width), (0.05, length), (r.choice([0.0, 0.12]), base), frame),
        box(inner, (0.07, length - 0.03), (base, height), sheet),
    ]
    parts += bedclothes(textures, (width, length, height), blanket)
    if r.random() < 0.85:
        outer, high = (-width / 2 - 0.03, width / 2 + 0.03), height + r.uniform(0.15, 0.8)
        thick = r.uniform(0.04, 0.12)
        head = frame if r.random() < 0.6 else textures.cloth()
        parts.append(box(outer, (0, thick), (0, high), head))
        if r.random() < 0.3:
            foot = (0, height + r.uniform(0.0, 0.2))
            parts.append(box(outer, (length, length + 0.05), foot, frame))
    pillow = textures.cloth() if r.random() < 0.5 else sheet
    parts += [
        cushion((min(0.36, width / 4.2), 0.22, 0.09), (x, 0.36, height + 0.07), pillow)
        for x in ([0] if width < 1.3 else [-width / 4, width / 4])
    ]
    return Piece("bed", merge(parts), width + 0.1, length + 0.05)


def bedclothes(textures, size, texture):
    """A blanket over a bed of `size` (width, length, height), by chance folded back, or none."""
    r, (width, length, height), parts = textures.random, size, []
    start, drop = r.uniform(0.3, 0.9), r.uniform(0.02, height - 0.1)
    if r.random() < 0.85:
        x = (-width / 2 - 0.01, width / 2 + 0.01)
        z = (height - drop, height + r.uniform(0.02, 0.07))
        parts.append(box(x, (start, length + 0.01), z, texture))
        if r.random() < 0.5:
            fold, x = textures.cloth(), (-width / 2 - 0.015, width / 2 + 0.015)
            parts.append(box(x, (start, start + 0.25), (height - drop, height + 0.075), fold))
    return parts


def cushion(size, at, texture):
    """A rounded block with half sides `size` around `at`."""
    shape = trimesh.creation.icosphere(2)
    rounded = np.sign(shape.vertices) * np.abs(shape.vertices) ** 0.6
    points = rounded * np.array(size) + at
    return Part(points, shape.faces, points[shape.faces][..., :2] / 0.6, texture)


def table(textures, word="table"):
    """A table or a "coffee table": four legs, now and then round on one column."""
    r = textures.random
    width, depth, height = r.uniform(0.9, 1.7), r.uniform(0.6, 0.95), r.uniform(0.68, 0.8)
    if word == "coffee table":
        height = r.uniform(0.32, 0.48)
    top = textures.surface()
    leg = top if r.random() < 0.5 else textures.surface()
    if r.random() < 0.2:
        parts = [
            cylinder(0.45, (height - 0.03, height), top, at=(0, 0.45), sides=24),
            cylinder(0.05, (0, height), leg, at=(0, 0.45)),
            cylinder(0.25, (0, 0.03), leg, at=(0, 0.45)),
        ]
        return Piece(word, merge(parts), 0.6, 0.6, height)
    parts = board(width, depth, height, top, r.uniform(0.02, 0.06))
    parts += legs(width, depth, height, leg, r.uniform(0.015, 0.045))
    return Piece(word, merge(parts), width, depth, height)


def desk(textures):
    r = textures.random
    width, depth, height = r.uniform(1.0, 1.6), r.uniform(0.5, 0.75), r.uniform(0.7, 0.78)
    top = textures.surface()
    parts = board(width, depth, height, top)
    if r.random() < 0.7:
        drawers = chest(textures, "", (0.4, depth - 0.08, height - 0.04), (1, 3)).part
        parts.append(drawers.moved(shift=(width / 2 - 0.22, 0, 0)))
        parts.append(box((-width / 2, -width / 2 + 0.03), (0, depth), (0, height), top))
    else:
        parts += legs(width, depth, height, top)
    return Piece("desk", merge(parts), width, depth, height)


def chair(textures):
    r = textures.random
    width, depth, height = r.uniform(0.38, 0.52), r.uniform(0.4, 0.5), r.uniform(0.42, 0.5)
    frame = textures.surface()
    seat = textures.cloth() if r.random() < 0.5 else textures.surface()
    parts = board(width, depth, height, seat, r.uniform(0.03, 0.09))
    if r.random() < 0.25:  # on a column with a star-shaped foot
        parts.append(cylinder(0.03, (0.05, height), frame, at=(0, depth / 2)))
        ray = box((0, 0.28), (-0.02, 0.02), (0.03, 0.07), frame)
        parts += [ray.moved(a, (0, depth / 2, 0)) for a in np.arange(5) * 2 * np.pi / 5]
    else:
        parts += legs(width, depth, height, frame, r.uniform(0.012, 0.025))
    back = height + r.uniform(0.3, 0.6)
    if r.random() < 0.5:
        parts.append(box(span(width), (0, 0.04), (height + r.choice([0, 0.15]), back), seat))
    else:
        bars = np.linspace(-width / 2 + 0.02, width / 2 - 0.02, int(r.integers(2, 6)))
        parts += [box((x - 0.015, x + 0.015), (0, 0.03), (height, back), frame) for x in bars]
        parts.append(box(span(width), (0, 0.03), (back - 0.08, back), frame))
    if r.random() < 0.3:
        parts += [
            box((x - 0.02, x + 0.02), (0, depth), (height + 0.2, height + 0.23), frame)
            for x in span(width)
        ]
    return Piece("chair", merge(parts), width, depth)


def sofa(textures):
    r = textures.random
    width, depth, height = r.uniform(1.2, 2.4), r.uniform(0.75, 1.0), r.uniform(0.36, 0.48)
    cloth = textures.cloth() if r.random() < 0.6 else textures.plain()
    arm, back = r.uniform(0.1, 0.25), r.uniform(0.65, 0.95)
    parts = [
        box(span(width), (0, depth), (r.choice([0.02, 0.1]), height - 0.12), cloth),
        box(span(width), (0, r.uniform(0.15, 0.28)), (0.1, back), cloth),
    ]
    count = max(1, int((width - 2 * arm) / 0.7))
    edges = np.linspace(-width / 2 + arm, width / 2 - arm, count + 1)
    seat = cloth if r.random() < 0.8 else textures.cloth()
    for left, right in itertools.pairwise(edges):
        x = (left + 0.01, right - 0.01)
        parts.append(box(x, (0.2, depth), (height - 0.12, height), seat))
        parts.append(box(x, (0.2, 0.36), (height, back + 0.05), seat))
    high = height + r.uniform(0.08, 0.25)
    parts += [
        box((-width / 2, -width / 2 + arm), (0, depth), (0.05, high), cloth),
        box((width / 2 - arm, width / 2), (0, depth), (0.05, high), cloth),
    ]
    return Piece("sofa", merge(parts), width, depth)


def trash_can(textures):
    radius = textures.random.uniform(0.1, 0.18)
    z = (0, textures.random.uniform(0.25, 0.5))
    can = cylinder(radius, z, textures.plain(), top=radius * 1.25, at=(0, 0.2))
    return Piece("trash can", can, 0.4, 0.4)


def floor_lamp(textures):
    r, at = textures.random, (0, 0.2)
    height, metal = r.uniform(1.3, 1.7), textures.plain()
    foot, pole = cylinder(0.14, (0, 0.03), metal, at=at), cylinder(0.015, (0, height), metal, at=at)
    cloth, z = textures.plain(), (height - 0.1, height + 0.2)
    shade = cylinder(0.2, z, cloth, top=r.uniform(0.08, 0.2), at=at)
    return Piece("lamp", merge([foot, pole, shade]), 0.4, 0.4)


def plant(textures):
    r = textures.random
    pot = cylinder(0.13, (0, 0.28), textures.plain(), top=0.17, at=(0, 0.25))
    tone = np.array([50, 110, 45]) * r.uniform(0.5, 1.5)
    green = textures.add(tone + textures.noise(30, 30) * 20)
    leaves = []
    for _ in range(40):
        turn, rise, length = r.uniform(0, 2 * np.pi), r.uniform(0.2, 1.3), r.uniform(0.25, 0.7)
        leaf = np.array([[0, 0, 0.27], [0.5, 0.12, 0.27], [1, 0, 0.27], [0.5, -0.12, 0.27]])
        leaf = leaf * [length, length, 1]
        along = leaf[:, 0].copy()
        leaf[:, 0], leaf[:, 2] = along * np.cos(rise), 0.27 + along * np.sin(rise)
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        leaves.append(Part(leaf, faces, leaf[faces][..., :2], green).moved(turn, (0, 0.25, 0)))
    return Piece("potted plant", merge([pot, *leaves]), 0.5, 0.5)


# what stands along walls: builder and chance
ALONG_WALLS = {
    bed: 0.2,
    storage.nightstand: 0.06,
    storage.cabinet: 0.1,
    storage.wardrobe: 0.13,
    storage.refrigerator: 0.05,
    storage.tv_cabinet: 0.06,
    desk: 0.12,
    sofa: 0.1,
    storage.bookcase: 0.08,
    trash_can: 0.03,
    floor_lamp: 0.03,
    plant: 0.02,
    chair: 0.02,
}


def along_walls(textures):
    """A random piece of furniture for a place at a wall."""
    builders, chances = list(ALONG_WALLS), list(ALONG_WALLS.values())
    return builders[textures.random.choice(len(builders), p=chances)](textures)
