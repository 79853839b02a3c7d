"""Furnished rooms: reproducible, labelled, and seen from inside."""

import json

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("trimesh")
pytest.importorskip("embreex")

from lexsplat_training.scenes.camera import random_view
from lexsplat_training.scenes.caster import Caster
from lexsplat_training.scenes.room import Room
from lexsplat_training.scenes.textures import Textures


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    pixels = np.random.default_rng(0).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    Image.fromarray(pixels).resize((160, 120)).save(folder / "0.jpg")
    return folder


def view(photos, seed):
    """(room, rgb, ids, depth) of a small view of a room."""
    random = np.random.default_rng(seed)
    room = Room(Textures(photos, [], random), {}, [], random)
    caster = Caster(room, random)
    pose, focal = random_view(room, caster, random, near=False)
    return room, *caster.render(pose, 64, 48, focal * 64, 1)


def test_same_seed_gives_the_same_view(photos):
    first, again, other = (view(photos, seed) for seed in (1, 1, 2))
    assert first[0].words == again[0].words
    assert all(np.array_equal(a, b) for a, b in zip(first[1:], again[1:], strict=True))
    assert not np.array_equal(first[1], other[1])


def test_every_pixel_shows_an_object_inside_the_room(photos):
    for seed in range(3):
        room, _, ids, depth = view(photos, seed)
        assert json.dumps([str(word) for word in room.words])
        assert (ids == 0).mean() < 0.02
        assert ids.max() <= len(room.words)
        assert depth.max() < np.linalg.norm(room.size)


def test_furniture_stands_apart(photos):
    room, *_ = view(photos, 3)
    rectangles = room.taken
    assert len(rectangles) > 3
    for at, (low, high) in enumerate(rectangles):
        for near, far in rectangles[:at]:
            assert np.any(low >= far) or np.any(high <= near)
