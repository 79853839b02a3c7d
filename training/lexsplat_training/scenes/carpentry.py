"""What built furniture has in common: the piece itself, legs, boards, doors and drawers.

Local axes: x along the wall and centred, y away from the wall with the back at y = 0, z up. Metres.
"""

from dataclasses import dataclass, field

import numpy as np

from .part import Part, box, merge, span


@dataclass
class Piece:
    """A piece of furniture and the floor that it takes."""

    word: str
    part: Part
    width: float
    depth: float
    top: float | None = None  # height of a surface that small objects may stand on
    contents: list[tuple[str, Part]] = field(default_factory=list)  # objects inside, with words


def legs(width, depth, height, texture, thick=0.03):
    """Four legs, each 2 `thick` wide."""
    x, y = width / 2 - thick, depth - thick
    return [
        box((a - thick, a + thick), (b - thick, b + thick), (0, height), texture)
        for a in (-x, x)
        for b in (thick, y)
    ]


def board(width, depth, height, texture, thick=0.03):
    """A horizontal board with its upper side at `height`."""
    return [box(span(width), (0, depth), (height - thick, height), texture)]


def fronts(textures, body, z, texture, layout):
    """Doors or drawers with handles on the front of a piece, from z[0] to z[1].

    body: (width, depth) of the piece; layout: (columns, rows) of doors or drawers.
    """
    (width, depth), (columns, rows), random = body, layout, textures.random
    handle = textures.plain()
    round_handle, gap = random.random() < 0.5, random.uniform(0.005, 0.02)
    face, knob = (depth, depth + 0.02), (depth + 0.02, depth + 0.045)
    parts = []
    for i in range(columns):
        x = np.array([i, i + 1]) * width / columns - width / 2
        for j in range(rows):
            low = z[0] + (z[1] - z[0]) * j / rows
            high = z[0] + (z[1] - z[0]) * (j + 1) / rows
            parts.append(box((x[0] + gap, x[1] - gap), face, (low + gap, high - gap), texture))
            middle, half = x.mean(), 0.015 if round_handle else min(0.08, width / columns / 4)
            centre = (low + high) / 2
            if columns > 1 and rows == 1:  # doors in pairs, handles upright where they meet
                middle = x[1 - i % 2] + (0.05 if i % 2 else -0.05)
                across, along = (middle - 0.012, middle + 0.012), (centre - half, centre + half)
            else:
                across, along = (middle - half, middle + half), (centre - 0.012, centre + 0.012)
            parts.append(box(across, knob, along, handle))
    return parts


def chest(textures, word, size, layout):
    """A closed body with doors or drawers; `size` (width, depth, height), on feet by chance."""
    width, depth, height = size
    body = textures.surface()
    front = body if textures.random.random() < 0.6 else textures.surface()
    foot = textures.random.choice([0.0, 0.05, 0.15])
    parts = [box(span(width), (0, depth), (foot, height), body)]
    parts += fronts(textures, (width, depth), (foot + 0.02, height - 0.03), front, layout)
    if foot:
        parts += legs(width, depth, foot, body, 0.02)
    return Piece(word, merge(parts), width, depth + 0.05, height)
