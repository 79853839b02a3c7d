"""What lies on tables: laptops, screens, books, lamps, vessels.

Every builder takes `Textures` and returns a part with its foot at z = 0, centred. Metres.
"""

import numpy as np

from .part import box, cylinder, image_box, merge, span
from .textures import SIDE
from .wall_decor import grey


def keys(textures, base, rise, side):
    """A chequered texture: squares of `side` pixels, grey `base` and `base + rise`."""
    checks = (np.indices((SIDE, SIDE)) // side % 2).sum(0) % 2
    return textures.add(np.full((SIDE, SIDE, 3), base) + rise * checks[..., None])


def laptop(textures):
    body = textures.plain()
    shown = textures.photo() if textures.random.random() < 0.6 else textures.plain()
    lid = image_box(span(0.34), (-0.13, -0.115), (0.01, 0.23), body, shown)
    board = box(span(0.3), (-0.08, 0.04), (0.015, 0.017), keys(textures, 60.0, 50, 6), 0.2)
    return merge([box(span(0.34), (-0.12, 0.12), (0, 0.015), body), board, lid])


def monitor(textures):
    r = textures.random
    width, dark = r.uniform(0.4, 0.65), grey(textures, (8, 60), 3, 5)
    low = r.uniform(0.08, 0.16)
    shown = dark if r.random() < 0.4 else textures.photo()
    face = image_box(span(width), (-0.02, 0.02), (low, low + width * 0.6), dark, shown)
    pole = box(span(0.06), (-0.05, -0.02), (0, low + 0.1), dark)
    return merge([face, pole, box(span(0.24), (-0.1, 0.08), (0, 0.015), dark)])


def computer_keyboard(textures):
    texture = keys(textures, textures.random.choice([25, 210]), 30, 8)
    return box(span(0.42), span(0.14), (0, 0.02), texture, 0.25)


def book(textures):
    """A pile of one to four books."""
    r, parts, z = textures.random, [], 0.0
    for _ in range(r.integers(1, 5)):
        width, depth, height = r.uniform(0.12, 0.2), r.uniform(0.18, 0.27), r.uniform(0.008, 0.04)
        cover = textures.photo() if r.random() < 0.7 else textures.plain()
        one = box(span(width), span(depth), (z, z + height), cover, 0.25)
        parts.append(one.moved(r.uniform(-0.4, 0.4)))
        z += height
    return merge(parts)


def lamp(textures):
    r, metal = textures.random, textures.plain()
    height = r.uniform(0.25, 0.5)
    foot = cylinder(0.07, (0, 0.02), metal)
    pole = cylinder(r.uniform(0.01, 0.05), (0, height), metal)
    shade = textures.plain()
    z = (height - 0.05, height + 0.13)
    return merge([foot, pole, cylinder(0.13, z, shade, r.uniform(0.06, 0.13))])


def vase(textures):
    radius = textures.random.uniform(0.04, 0.1)
    lower = cylinder(radius, (0, radius * 2), textures.any(), radius * 1.3)
    z = (radius * 2, radius * 4)
    return merge([lower, cylinder(radius * 1.3, z, textures.any(), radius * 0.6)])


def mug(textures):
    texture = textures.plain() if textures.random.random() < 0.7 else textures.photo()
    handle = [  # x and z of its three bars
        ((0.04, 0.065), (0.02, 0.03)),
        ((0.04, 0.065), (0.065, 0.075)),
        ((0.058, 0.066), (0.02, 0.075)),
    ]
    bars = [box(x, (-0.007, 0.007), z, texture) for x, z in handle]
    return merge([cylinder(0.04, (0, 0.09), texture), *bars])


def bottle(textures):
    glass = textures.plain()
    neck = cylinder(0.035, (0.18, 0.23), glass, 0.013)
    cap = cylinder(0.014, (0.23, 0.26), textures.plain())
    return merge([cylinder(0.035, (0, 0.18), glass), neck, cap])


def cardboard_box(textures):
    width, depth, height = textures.random.uniform(0.15, 0.4, 3)
    return box(span(width), span(depth), (0, height), textures.wood(), 0.7)


def photo_frame(textures):
    frame, photo = textures.surface(), textures.photo()
    return image_box(span(0.16), span(0.02), (0, 0.2), frame, photo)


ON_TOP = {
    "laptop": laptop,
    "screen": monitor,
    "monitor": monitor,
    "computer keyboard": computer_keyboard,
    "book": book,
    "lamp": lamp,
    "vase": vase,
    "mug": mug,
    "bottle": bottle,
    "cardboard box": cardboard_box,
    "photo frame": photo_frame,
}


def on_top(textures):
    """(word, part) of a random thing for a table."""
    word = textures.random.choice(list(ON_TOP))
    return word, ON_TOP[word](textures)
