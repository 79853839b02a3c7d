"""Exported files, as numpy arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from lexsplat._geometry import Array

_PLY_TYPES = {"float": "<f4", "uchar": "u1"}
_PLY_END = b"end_header\n"


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where each tracked frame was taken.

    Attributes:
        sequences: Numbers of the frames, (count,).
        times: Seconds, (count,).
        poses: world_from_camera, (count, 4, 4), metres.
    """

    sequences: npt.NDArray[np.uint64]
    times: Array
    poses: Array

    @classmethod
    def _of(cls, data: bytes) -> Trajectory:
        frames = json.loads(data)
        return cls(
            np.array([frame["sequence"] for frame in frames], dtype=np.uint64),
            np.array([frame["timestamp_nanos"] for frame in frames], dtype=np.float64) / 1e9,
            np.array([frame["world_from_camera"] for frame in frames]).reshape(-1, 4, 4),
        )


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The centres of a map's Gaussians.

    Attributes:
        positions: (count, 3), float32, metres.
        colors: (count, 3), uint8, red green blue.
    """

    positions: npt.NDArray[np.float32]
    colors: npt.NDArray[np.uint8]

    @classmethod
    def _of(cls, data: bytes) -> PointCloud:
        vertices = _vertices(data)
        positions = np.stack([vertices[name] for name in ("x", "y", "z")], axis=-1)
        colors = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=-1)
        return cls(positions, colors)


def _vertices(data: bytes) -> npt.NDArray[Any]:
    """The vertices of a binary PLY of the server, one field for each property."""
    end = data.index(_PLY_END) + len(_PLY_END)
    lines = [line.split() for line in data[:end].decode("ascii").splitlines()]
    count = next(int(line[2]) for line in lines if line[:2] == ["element", "vertex"])
    properties = [(line[2], _PLY_TYPES[line[1]]) for line in lines if line[0] == "property"]
    return np.frombuffer(data, np.dtype(properties), count, end)
