"""Pasted screens and prints: where they are labelled, from one seed the same, and none unasked."""

import numpy as np
import pytest

from data import Scenes, Words
from screens import HANGING, LYING, SCREENS, Screens, corners

PHOTOS = [np.full((90, 120, 3), tone, np.uint8) for tone in (40, 200)]


def pasted(seed, is_screen):
    """A grey image and its empty label map after one thing was pasted; and the words."""
    words = Words()
    image, label = np.full((224, 320, 3), 90, np.uint8), np.full((56, 80), -1)
    Screens(words, PHOTOS, np.random.default_rng(seed)).one(image, label, is_screen)
    return image, label, words


@pytest.mark.parametrize("is_screen", [True, False])
def test_labels_lie_on_what_was_pasted_and_bear_its_words(is_screen):
    allowed, shown = {*SCREENS, "laptop"} if is_screen else {*LYING, *HANGING}, 0
    for seed in range(25):
        image, label, words = pasted(seed, is_screen)
        assert {words.names[k] for k in np.unique(label[label >= 0])} <= allowed
        changed = (image != 90).any(2)[2::4, 2::4]
        if (label >= 0).any():
            shown += 1
            assert changed[label >= 0].mean() > 0.8
    assert shown > 15


def test_one_seed_makes_one_image():
    first, again, other = (pasted(seed, True) for seed in (3, 3, 4))
    assert np.array_equal(first[0], again[0]) and np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])


def test_screens_give_light_and_prints_do_not():
    def brightest(is_screen):
        """In a dark image, the mean over seeds of the brightest pixel's grey."""
        tops = []
        for seed in range(25):
            image = np.full((224, 320, 3), 20, np.uint8)
            screens = Screens(Words(), [], np.random.default_rng(seed))
            screens.one(image, np.full((56, 80), -1), is_screen)
            tops.append(image.mean(2).max())
        return np.mean(tops)

    assert brightest(True) > 2 * brightest(False)


def test_a_rectangle_seen_straight_on_keeps_its_sides():
    assert np.allclose(corners(40, 20, 0, 0, 0), [(-20, -10), (20, -10), (20, 10), (-20, 10)])


@pytest.mark.parametrize("chance", [0.0, 1.0])
def test_frames_hold_screens_by_their_chance_only(chance):
    words = Words()
    wall = words.add("wall")
    frame = np.full((240, 320, 3), 120, np.uint8), np.full((240, 320), wall, np.int16)
    scenes = Scenes([(1.0, [frame])], [], words, (320, 224), 0.0, 5, chance)
    found = {words.names[k] for _ in range(6) for k in np.unique(scenes.draw(scenes.size)[1])}
    assert (found == {"wall"}) == (chance == 0)
