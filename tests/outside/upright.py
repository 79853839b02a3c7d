"""Checks that files of one map, exported with an axis up, stand upright.

    PYTHONPATH=.deps/readers:.deps/gsply python3 tests/outside/upright.py FOLDER

The folder has map.ply (the map's own coordinates, which are tilted), z.ply (z up), y.spz (y up),
y.glb (glTF: y up), minus_y.ply (a mesh, -y up) and z.tum (a trajectory, z up). In each the largest
plane that is roughly level must be level and have hardly anything below it: the floor.
"""

import sys
from pathlib import Path

import gsply_cpp
import numpy as np
import trimesh
from files import read_splats

# Measured: 0.3 with Gaussians, 3.5 with a mesh of a map that has had few steps.
DEGREES, MESH_DEGREES = 1, 8
ROUGHLY_DEGREES = 25
TRIES = 30_000
NEAR_METRES = 0.03


def floor(points, areas, up):
    """Degrees between the floor's normal and up; shares of the map in the floor and above it."""
    height = points @ up
    low = height < np.quantile(height, 0.5)
    rng = np.random.default_rng(7)
    chosen = rng.choice(np.flatnonzero(low), (TRIES, 3), p=areas[low] / areas[low].sum())
    a, b, c = (points[chosen[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    level = np.abs(normals @ up) > lengths * np.cos(np.radians(ROUGHLY_DEGREES))
    normals, a = (of[level & (lengths > 0.1)][:2000] for of in (normals, a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sample = rng.choice(len(points), 4000, p=areas / areas.sum())
    distance = points[sample] @ normals.T - (normals * a).sum(1)
    best = (np.abs(distance) < NEAR_METRES).sum(0).argmax()
    normal, distance = normals[best], distance[:, best]
    # The plane that fits all points near it, instead of three.
    for _ in range(5):
        near = points[sample][np.abs(distance) < NEAR_METRES]
        middle = near.mean(0)
        normal = np.linalg.svd(near - middle, full_matrices=False)[2][2]
        normal = -normal if normal @ up < 0 else normal
        distance = (points[sample] - middle) @ normal
    inside = (np.abs(distance) < NEAR_METRES).mean()
    return np.degrees(np.arccos(min(normal @ up, 1))), inside, (distance > -2 * NEAR_METRES).mean()


def assert_upright(name, points, areas, up, most=DEGREES):
    degrees, inside, above = floor(points, areas, np.array(up, float))
    found = f"{name}: {inside:.0%} is in the floor, {above:.0%} above it, {degrees:.2f} degrees off"
    assert degrees < most and inside > 0.05 and above > 0.95, found
    print(found)


def areas(log_scale):
    """Areas of disks: their two larger axes."""
    return np.exp(np.sort(log_scale, axis=1)[:, 1:].sum(1))


def main():
    folder = Path(sys.argv[1])
    tilted, splats = read_splats(folder / "map.ply"), read_splats(folder / "z.ply")
    assert_upright("z.ply", splats["means"], areas(splats["log_scale"]), [0, 0, 1])
    spz = gsply_cpp.read_spz(str(folder / "y.spz"))
    assert_upright("y.spz", spz["means"].astype(float), areas(spz["scales"]), [0, 1, 0])
    scene = trimesh.load(str(folder / "y.glb"))
    points = scene.to_geometry().vertices
    assert_upright("y.glb", np.asarray(points), areas(tilted["log_scale"]), [0, 1, 0])
    mesh = trimesh.load(str(folder / "minus_y.ply"), process=False)
    points = np.asarray(mesh.vertices)
    assert_upright("minus_y.ply", points, np.ones(len(points)), [0, -1, 0], MESH_DEGREES)
    # Cameras are above the floor at the height of a hand, and their y axes point down.
    poses = np.loadtxt(folder / "z.tum")
    above = poses[:, 3] - np.quantile(splats["means"][:, 2], 0.01)
    assert ((above > 0.5) & (above < 2.5)).all(), f"cameras are {above} m above the floor"
    x, y, z, w = poses[:, 4:].T
    height = 2 * (y * z + x * w)
    assert (height < -0.7).all(), f"the z of the cameras' y axes: {height}"
    # Negative control: the map's own coordinates are tilted.
    try:
        assert_upright("map.ply", tilted["means"], areas(tilted["log_scale"]), [0, 0, 1])
    except AssertionError:
        return
    raise AssertionError("this test does not see that a map is tilted")


if __name__ == "__main__":
    main()
