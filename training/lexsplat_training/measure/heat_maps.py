"""Relevancy drawn over an image."""

import numpy as np
from PIL import Image

SIZE = (288, 216)  # width, height of a tile
COLUMNS = 4


def colors(heat):
    """Values 0..1 as colors from black over red and yellow to white, uint8 [h, w, 3]."""
    heat = heat.clip(0, 1)[..., None] * 3
    return (np.concatenate([heat, heat - 1, heat - 2], -1).clip(0, 1) * 255).astype(np.uint8)


def write(image, heats, words, path):
    """Writes the image and a heat map per word as one PNG; colors span relevancies 0.3 to 0.9."""
    tiles = [np.asarray(Image.fromarray(image).resize(SIZE))]
    for heat in heats:
        ramp = Image.fromarray(colors((heat - 0.3) / 0.6)).resize(SIZE)
        tiles.append((0.35 * tiles[0] + 0.65 * np.asarray(ramp)).astype(np.uint8))
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[k : k + COLUMNS], 1) for k in range(0, len(tiles), COLUMNS)]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(rows)).save(path)
    print(f"{path}: {', '.join(words)}")
