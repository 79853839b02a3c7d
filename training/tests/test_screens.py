"""Pasted screens and prints: their labels, their light, and how often they are pasted."""

import numpy as np
import pytest

from lexsplat_training.samples.sampler import Sampler
from lexsplat_training.samples.screens import HANGING, LYING, SCREENS, Screens, corners
from lexsplat_training.samples.words import Words

PHOTOS = [np.full((90, 120, 3), tone, np.uint8) for tone in (40, 200)]


def pasted(seed, is_screen):
    """(image, label map, words) after one screen or print was pasted into a grey image."""
    words = Words()
    image, label = np.full((224, 320, 3), 90, np.uint8), np.full((56, 80), -1)
    Screens(words, PHOTOS, np.random.default_rng(seed)).put_one(image, label, is_screen)
    return image, label, words


@pytest.mark.parametrize("is_screen", [True, False])
def test_labels_cover_what_was_pasted_and_have_its_words(is_screen):
    allowed, shown = {*SCREENS, "laptop"} if is_screen else {*LYING, *HANGING}, 0
    for seed in range(25):
        image, label, words = pasted(seed, is_screen)
        assert {words.names[k] for k in np.unique(label[label >= 0])} <= allowed
        changed = (image != 90).any(2)[2::4, 2::4]
        if (label >= 0).any():
            shown += 1
            assert changed[label >= 0].mean() > 0.8
    assert shown > 15


def test_same_seed_gives_the_same_image():
    first, again, other = (pasted(seed, True) for seed in (3, 3, 4))
    assert np.array_equal(first[0], again[0]) and np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])


def test_screens_are_brighter_than_prints_in_a_dark_image():
    def brightest(is_screen):
        """Mean over seeds of the brightest pixel's grey."""
        tops = []
        for seed in range(25):
            image = np.full((224, 320, 3), 20, np.uint8)
            screens = Screens(Words(), [], np.random.default_rng(seed))
            screens.put_one(image, np.full((56, 80), -1), is_screen)
            tops.append(image.mean(2).max())
        return np.mean(tops)

    assert brightest(True) > 2 * brightest(False)


def test_rectangle_seen_straight_on_keeps_its_sides():
    assert np.allclose(corners(40, 20, 0, 0, 0), [(-20, -10), (20, -10), (20, 10), (-20, 10)])


@pytest.mark.parametrize("chance", [0.0, 1.0])
def test_frames_hold_screens_with_the_given_chance(chance):
    words = Words()
    wall = words.add("wall")
    frame = np.full((240, 320, 3), 120, np.uint8), np.full((240, 320), wall, np.int16)
    sampler = Sampler([(1.0, [frame])], [], words, (320, 224), 5, screens=chance)
    found = {words.names[k] for _ in range(6) for k in np.unique(sampler.draw(sampler.size)[1])}
    assert (found == {"wall"}) == (chance == 0)
