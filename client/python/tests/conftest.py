"""A server and a room for the tests: `tests/service/python.rs` makes both."""

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import lexsplat

# Frames of the room come at this rate.
INTERVAL = 1 / 30


def setting(name: str) -> str:
    """What the test of the service tells."""
    value = os.environ.get(f"LEXSPLAT_TEST_{name}")
    assert value, f"LEXSPLAT_TEST_{name} is not set: cargo test -p lexsplat-tests python_client"
    return value


@dataclass
class Room:
    """A synthetic room in Replica's layout."""

    folder: Path
    camera: lexsplat.Camera
    depth_unit: float
    poses: np.ndarray

    def color(self, number: int) -> np.ndarray:
        with Image.open(self.folder / f"results/frame{number:06d}.jpg") as image:
            return np.array(image)

    def depth(self, number: int) -> np.ndarray:
        with Image.open(self.folder / f"results/depth{number:06d}.png") as image:
            return np.array(image).astype(np.uint16)

    def frame(self, number: int, **more) -> lexsplat.Frame:
        """A frame as numpy arrays, with its pose."""
        fields = {"time": number * INTERVAL, "pose": self.poses[number]} | more
        return lexsplat.Frame(self.color(number), self.depth(number), **fields)

    def frames(self, count: int | None = None, **more) -> Iterator[lexsplat.Frame]:
        for number in range(len(self.poses[:count])):
            yield self.frame(number, **more)


@pytest.fixture(scope="session")
def room() -> Room:
    folder = Path(setting("ROOM"))
    read = json.loads((folder / "cam_params.json").read_text())["camera"]
    camera = lexsplat.Camera(*(read[key] for key in ("w", "h", "fx", "fy", "cx", "cy")))
    poses = np.loadtxt(folder / "traj.txt").reshape(-1, 4, 4)
    return Room(folder, camera, 1 / read["scale"], poses)


@pytest.fixture(scope="session")
def address() -> str:
    return setting("GRPC")


@pytest.fixture
def client(address: str) -> Iterator[lexsplat.Client]:
    with lexsplat.Client(address, patience=60) as client:
        yield client


@pytest.fixture
def new_map(client: lexsplat.Client, request: pytest.FixtureRequest) -> Iterator[lexsplat.Map]:
    """A map of the test's own, which is deleted afterwards."""
    made = client.map("".join(c if c.isalnum() else "-" for c in request.node.name)[:60])
    yield made
    with contextlib.suppress(lexsplat.NotFoundError):
        made.delete()


@pytest.fixture(scope="session")
def mapped(address: str, room: Room) -> Iterator[lexsplat.Map]:
    """A map of all frames of the room, which tests only read."""
    with lexsplat.Client(address, patience=60) as client:
        made = client.map("mapped")
        made.stream(room.frames(), room.camera, poses="given", depth_unit=room.depth_unit)
        yield made
        made.delete()
