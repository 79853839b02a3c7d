"""Labelled frames of rooms that lexsplat's own generator renders.

Their seeds are other ones than those of training, tests and the demonstration.
"""

import subprocess
from dataclasses import dataclass
from pathlib import Path

from ..command_line import InputError

FITTED = (300, 301, 302, 303)  # seeds of the rooms that compressor and scales are fitted to
SCORED = (310, 311)  # seeds of the rooms that the bundle is scored on
SIZE = (480, 360)  # width, height
WALK, EVERY = 180, 18  # frames of a walk around a room, and which of them are rendered
LEAST = 0.004  # share of a frame that a word must cover to be asked


@dataclass
class Rooms:
    """Folders of labelled frames."""

    fitted: list[Path]
    scored: list[Path]


def render(program, folder):
    """Renders the rooms that `folder` does not have yet; `program`: the command lexsplat."""
    fitted, scored = ([room(program, folder, seed) for seed in seeds] for seeds in (FITTED, SCORED))
    return Rooms(fitted, scored)


def room(program, folder, seed):
    """The folder of one room."""
    out = folder / f"room-{seed}"
    if out.exists():
        return out
    unfinished = folder / f"room-{seed}.unfinished"
    options = {"seed": seed, "frames": WALK, "every": EVERY, "width": SIZE[0], "height": SIZE[1]}
    line = [str(program), "synth", str(unfinished)]
    line += [part for name, value in options.items() for part in (f"--{name}", str(value))]
    try:
        subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError(f"rooms could not be rendered: {error}; is {program} built?") from None
    unfinished.replace(out)
    return out
