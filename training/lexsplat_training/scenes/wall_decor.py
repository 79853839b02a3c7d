"""What hangs on walls: doors, windows, curtains, screens, pictures.

Every builder takes `Textures` and returns (part, width): the back at y = 0, x centred, z above the
floor. Metres.
"""

import numpy as np

from .part import Part, box, image_box, merge, span
from .textures import SIDE


def grey(textures, tones, cells, depth):
    """A texture of one grey between `tones` (low, high), with noise of `cells` and `depth`."""
    tone = np.full((SIDE, SIDE, 3), textures.random.uniform(*tones))
    return textures.add(tone + textures.noise(cells, cells) * depth)


def door(textures):
    r = textures.random
    width, height = r.uniform(0.75, 1.0), r.uniform(1.95, 2.15)
    frame, leaf = textures.surface(), textures.surface()
    parts = [
        box(span(width + 0.16), (0, 0.03), (0, height + 0.08), frame),
        box(span(width), (0, 0.045), (0, height), leaf),
    ]
    if r.random() < 0.6:
        panels = ((0.2, height * 0.42), (height * 0.5, height - 0.15))
        parts += [box(span(width - 0.24), (0.045, 0.06), z, leaf) for z in panels]
    handle = (width / 2 - 0.15, width / 2 - 0.04)
    parts.append(box(handle, (0.05, 0.1), (1.0, 1.04), textures.plain()))
    return merge(parts), width + 0.2


def window(textures):
    r = textures.random
    width, low, high = r.uniform(0.8, 2.2), r.uniform(0.5, 1.1), r.uniform(1.9, 2.3)
    frame = textures.plain()
    if r.random() < 0.5:
        sky = textures.photo()
    else:
        blue = np.array([190, 215, 240]) * r.uniform(0.7, 1.08)
        sky = textures.add(blue + textures.noise(4, 4) * 10)
    parts = [image_box(span(width), (0, 0.02), (low, high), frame, sky)]
    upright = np.linspace(-width / 2, width / 2, int(r.integers(2, 5)))
    parts += [box((x - 0.03, x + 0.03), (0, 0.06), (low, high), frame) for x in upright]
    level = (low, high, (low + high) / 2)
    parts += [box(span(width), (0, 0.06), (z - 0.03, z + 0.03), frame) for z in level]
    return merge(parts), width


def curtain(textures):
    """A wavy sheet."""
    r = textures.random
    width, high, low = r.uniform(0.4, 1.4), r.uniform(2.0, 2.3), r.choice([0.02, 0.7])
    cloth, n = textures.cloth() if r.random() < 0.5 else textures.plain(), 40
    x = np.linspace(-width / 2, width / 2, n)
    y = 0.1 + 0.035 * np.sin(x * r.uniform(25, 60))
    points = np.concatenate([np.stack([x, y, np.full(n, z)], -1) for z in (low, high)])
    k = np.arange(n - 1)
    upper, lower = np.stack([k, k + 1, k + n], -1), np.stack([k + 1, k + n + 1, k + n], -1)
    faces = np.concatenate([upper, lower])
    return Part(points, faces, points[faces][..., [0, 2]], cloth), width


def air_conditioner(textures):
    r = textures.random
    width, height, z = r.uniform(0.7, 1.0), r.uniform(0.25, 0.33), r.uniform(1.85, 2.1)
    body = grey(textures, (190, 245), 5, 3)
    case = box(span(width), (0, r.uniform(0.15, 0.25)), (z, z + height), body)
    slot = box(span(width - 0.1), (0, 0.26), (z + 0.02, z + 0.05), textures.plain())
    return merge([case, slot]), width


def tv_screen(textures):
    """Dark, or with a picture on it."""
    r = textures.random
    width = r.uniform(0.7, 1.4)
    z, height, dark = r.uniform(0.7, 1.2), width * 0.58, grey(textures, (8, 45), 3, 6)
    shown = dark if r.random() < 0.6 else textures.photo()
    return image_box(span(width), (0.03, 0.08), (z, z + height), dark, shown), width


def picture(textures):
    r = textures.random
    width, height, z = r.uniform(0.25, 0.9), r.uniform(0.25, 0.9), r.uniform(1.2, 1.5)
    return framed(textures, width, height, z)


def clock(textures):
    """A square frame with a patch of a photograph as its face."""
    r = textures.random
    r.uniform(size=2)  # unused draws, kept so that seeds give the rooms of models/tiny
    z = r.uniform(1.2, 1.5)
    side = r.uniform(0.2, 0.35)
    return framed(textures, side, side, z)


def framed(textures, width, height, z):
    """A photograph in a frame, its lower edge at `z`."""
    frame, photo = textures.surface(), textures.photo()
    return image_box(span(width), (0, 0.03), (z, z + height), frame, photo), width


# word: builder and chance on a wall
HANGING = {
    "door": (door, 0.2),
    "window": (window, 0.22),
    "curtain": (curtain, 0.08),
    "air conditioner": (air_conditioner, 0.12),
    "tv screen": (tv_screen, 0.12),
    "picture": (picture, 0.2),
    "clock": (clock, 0.06),
}


def hanging(textures):
    """(word, part, width) of a random thing for a wall."""
    word = textures.random.choice(list(HANGING), p=[chance for _, chance in HANGING.values()])
    return word, *HANGING[word][0](textures)
