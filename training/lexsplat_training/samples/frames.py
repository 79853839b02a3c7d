"""Labelled RGB frames in Replica layout: results/, semantic/, instances.json, traj.txt."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from . import images


def read_frames(folder, words, skip=None, limit=None):
    """Yields (rgb uint8 [h, w, 3], word per pixel int16 [h, w], -1 = none) of one folder.

    words: `Words`, which numbers the classes; held-out classes become -1. skip: a box (x0, y0, x1,
    y1) in metres; frames taken from inside it are left out. limit: at most so many frames.
    """
    folder = Path(folder)
    table = np.full(65536, -1, np.int16)
    for row in json.loads((folder / "instances.json").read_text()):
        if row["class"] not in words.held_out:
            table[row["id"]] = words.add(row["class"])
    poses = np.loadtxt(folder / "traj.txt").reshape(-1, 4, 4)
    files = sorted((folder / "results").glob("frame*.jpg"))
    for path, pose in list(zip(files, poses, strict=False))[:limit]:
        x, y = pose[0, 3], pose[1, 3]
        if skip and skip[0] < x < skip[2] and skip[1] < y < skip[3]:
            continue
        number = path.stem.removeprefix("frame")
        mask = np.asarray(Image.open(folder / "semantic" / f"{number}.png"))
        yield images.read(path), table[mask]


def read_all(folder, words, every=1):
    """Every n-th frame of a labelled folder, or of all labelled folders in it."""
    labelled = (folder / "traj.txt").exists()
    folders = [folder] if labelled else sorted(folder.iterdir())
    return [frame for one in folders for frame in read_frames(one, words)][::every]
