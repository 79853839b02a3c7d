"""What the simulated devices play: a walk through a synthetic room, and lenses that bend it."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

# Units of the recording's depth in a metre.
SCALE = 6553.5


@dataclass(frozen=True)
class Lens:
    """A camera, pixels; `coefficients` are k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV's rational model."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = ()

    @property
    def matrix(self) -> np.ndarray:
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    def scaled(self, width: int, height: int, coefficients: tuple[float, ...] = ()) -> Lens:
        """The same field of view with another number of pixels, and bent."""
        x, y = width / self.width, height / self.height
        center = (self.cx + 0.5) * x - 0.5, (self.cy + 0.5) * y - 0.5
        return Lens(width, height, self.fx * x, self.fy * y, *center, coefficients)

    def straightened(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the ray of each pixel meets the plane z = 1. Bending is undone step by step."""
        columns, rows = np.meshgrid(np.arange(self.width), np.arange(self.height))
        bent_x, bent_y = (columns - self.cx) / self.fx, (rows - self.cy) / self.fy
        if not any(self.coefficients):
            return bent_x, bent_y
        k1, k2, p1, p2, k3, k4, k5, k6 = self.coefficients
        x, y = bent_x, bent_y
        for _ in range(50):
            r = x * x + y * y
            radial = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))
            along_x = 2 * p1 * x * y + p2 * (r + 2 * x * x)
            along_y = 2 * p2 * x * y + p1 * (r + 2 * y * y)
            x, y = (bent_x - along_x) / radial, (bent_y - along_y) / radial
        return x, y


class Recording:
    """The walk: color, the depth of a camera beside it, and the depth of a phone."""

    def __init__(self) -> None:
        self._folder = Path(os.environ["LEXSPLAT_TEST_DEVICE"])
        calibration = json.loads((self._folder / "calibration.json").read_text())
        self.lenses = {name: Lens(*calibration[name]) for name in ("color", "depth", "phone")}
        self.color_from_depth = np.reshape(calibration["color_from_depth"], (4, 4))
        self.count = len(list(self._folder.glob("color*")))

    def color(self, number: int) -> np.ndarray:
        """Color as uint8; the walk begins again at its end."""
        return self._image("color", number)

    def depth(self, number: int, which: str = "depth") -> np.ndarray:
        """Depth in metres."""
        return self._image(which, number).astype(np.float64) / SCALE

    def _image(self, kind: str, number: int) -> np.ndarray:
        with Image.open(self._folder / f"{kind}{number % self.count:06d}") as image:
            return np.array(image)


def millimetres(depth: np.ndarray) -> np.ndarray:
    """Depth as most cameras give it."""
    return np.round(depth * 1000).astype(np.uint16)


def seen(image: np.ndarray, own: Lens, target: Lens) -> np.ndarray:
    """An image of one lens as another lens at the same place sees it; 0 where it is not known."""
    x, y = target.straightened()
    columns, rows = x * own.fx + own.cx, y * own.fy + own.cy
    is_inside = (columns > 0) & (columns < own.width - 1) & (rows > 0) & (rows < own.height - 1)
    if image.ndim == 2:
        near = np.rint(rows).clip(0, own.height - 1), np.rint(columns).clip(0, own.width - 1)
        return np.where(is_inside, image[near[0].astype(int), near[1].astype(int)], 0)
    left = np.floor(columns).clip(0, own.width - 2).astype(int)
    top = np.floor(rows).clip(0, own.height - 2).astype(int)
    right, down = (columns - left).clip(0, 1)[..., None], (rows - top).clip(0, 1)[..., None]
    above = image[top, left] * (1 - right) + image[top, left + 1] * right
    below = image[top + 1, left] * (1 - right) + image[top + 1, left + 1] * right
    return np.rint(above * (1 - down) + below * down).astype(np.uint8)
