"""Cabinets, wardrobes, refrigerators and bookcases in random proportions.

Every builder takes `Textures` and returns a `Piece`.
"""

import numpy as np

from .carpentry import Piece, chest, fronts
from .part import box, merge, span


def nightstand(textures):
    r = textures.random
    size = r.uniform(0.35, 0.6), r.uniform(0.32, 0.45), r.uniform(0.4, 0.65)
    return chest(textures, "nightstand", size, (1, int(r.integers(1, 4))))


def cabinet(textures):
    r = textures.random
    size = r.uniform(0.7, 1.8), r.uniform(0.35, 0.55), r.uniform(0.7, 1.2)
    return chest(textures, "cabinet", size, (int(r.integers(2, 5)), int(r.integers(1, 4))))


def wardrobe(textures):
    r = textures.random
    size = r.uniform(0.8, 2.0), r.uniform(0.5, 0.65), r.uniform(1.8, 2.25)
    made = chest(textures, "wardrobe", size, (int(r.integers(2, 5)), 1))
    return Piece("wardrobe", made.part, 2.0, 0.65)


def refrigerator(textures):
    r = textures.random
    width = r.uniform(0.55, 0.95)
    height, depth, body = r.uniform(1.5, 2.0), 0.65, textures.plain()
    layout = int(r.integers(1, 3)), int(r.integers(1, 3))
    parts = [box(span(width), (0, depth), (0.03, height), body)]
    parts += fronts(textures, (width, depth), (0.05, height), body, layout)
    return Piece("refrigerator", merge(parts), width, 0.7)


def tv_cabinet(textures):
    r = textures.random
    size = r.uniform(1.2, 2.0), r.uniform(0.35, 0.45), r.uniform(0.3, 0.55)
    return chest(textures, "tv cabinet", size, (int(r.integers(2, 4)), int(r.integers(1, 3))))


def book_row(textures, x, y, z):
    """Books from x[0] to x[1] on a board at z, their backs at y."""
    r, parts, at = textures.random, [], x[0]
    while True:
        width, height, depth = r.uniform(0.015, 0.05), r.uniform(0.16, 0.27), r.uniform(0.12, 0.2)
        if at + width > x[1]:
            return parts
        cover = textures.photo() if r.random() < 0.25 else textures.plain()
        parts.append(box((at, at + width), (y - depth, y), (z, z + height), cover, 0.15))
        at += width + r.choice([0.001, 0.001, 0.06])


def bookcase(textures):
    r = textures.random
    width, depth, height = r.uniform(0.6, 1.5), r.uniform(0.26, 0.36), r.uniform(1.0, 2.1)
    body = textures.surface()
    sides = (-width / 2, width / 2 - 0.025)
    parts = [box((x, x + 0.025), (0, depth), (0, height), body) for x in sides]
    parts.append(box(span(width), (0, 0.01), (0, height), body))
    books = []
    for z in np.linspace(0.05, height, int(height / 0.33) + 1):
        parts.append(box(span(width), (0, depth), (z - 0.02, z), body))
        if r.random() < 0.8 and z < height - 0.1:
            row = -width / 2 + 0.04, width / 2 - r.uniform(0.04, width / 2)
            books += book_row(textures, row, depth - 0.04, z)
    contents = [("book", merge(books))] if books else []
    return Piece("bookcase", merge(parts), width, depth, contents=contents)
