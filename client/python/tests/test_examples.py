"""The examples, run as a user runs them; devices are simulated (`devices/`)."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from conftest import Room

HERE = Path(__file__).resolve().parent
FRAMES = 8


def run(example: str, *arguments: str) -> str:
    """What an example prints."""
    path = os.pathsep.join([str(HERE / "devices"), os.environ["PYTHONPATH"]])
    ended = subprocess.run(
        [sys.executable, "-W", "error", HERE.parent / "examples" / example, *arguments],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, f"{ended.stdout}{ended.stderr}"
    assert ended.stderr == ""
    return ended.stdout


def test_ten_lines(client, address: str, room: Room):
    said = run("ten_lines.py", str(room.folder), "chair", address)
    assert f"{len(room.poses)} frames: {len(room.poses)} tracked, 0 lost, 0 refused" in said
    assert "Box(x=" in said
    client.map("ten-lines").delete()


def test_readme(client, address: str, room: Room, capsys):
    """The first program of the README, with the room's camera in place of its own."""
    readme = (HERE.parent / "README.md").read_text()
    program = readme.split("```python\n")[1].split("```")[0]
    for own, other in [
        ('"localhost"', repr(address)),
        ("640, 480, fx=585, fy=585, cx=320, cy=240", "**camera"),
        ("kitchen.stream(frames()", f"kitchen.stream(frames(), depth_unit={room.depth_unit}"),
        ("lexsplat.Camera(", "camera=lexsplat.Camera("),
    ]:
        assert own in program
        program = program.replace(own, other)
    camera = {
        name: getattr(room.camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")
    }
    pairs = [(room.color(number), room.depth(number)) for number in range(3)]
    exec(program, {"my_camera": lambda: pairs, "camera": camera})
    assert "3 frames: 3 tracked" in capsys.readouterr().out
    client.map("kitchen").delete()


@pytest.mark.parametrize("example", ["realsense", "oakd", "azure_kinect", "record3d_live"])
def test_devices(client, address: str, room: Room, example: str):
    said = run(f"{example}.py", "chair", str(FRAMES), address)
    assert f"{FRAMES} frames: {FRAMES} tracked, 0 lost, 0 refused" in said
    assert "Object(score=" in said
    made = client.map({"record3d_live": "record3d"}.get(example, example.replace("_", "-")))
    assert made.status().input_warnings == []
    # Poses are estimated, from the first camera on.
    true = np.linalg.inv(room.poses[0]) @ room.poses[:FRAMES]
    away = np.linalg.norm(made.trajectory().poses[:, :3, 3] - true[:, :3, 3], axis=1)
    walked = np.linalg.norm(true[-1, :3, 3])
    assert away.max() < 0.04 < walked, f"{away} of {walked} m"
    made.delete()


def test_every_example_is_run():
    files = {path.stem for path in (HERE.parent / "examples").glob("*.py")}
    assert files == {"ten_lines", "realsense", "oakd", "azure_kinect", "record3d_live"}
