"""Reads a map's exported files with other people's libraries and compares them with each other.

    PYTHONPATH=.deps/readers:.deps/gsply python3 tests/outside/files.py FOLDER

The folder has splats.ply, splats.spz, splats.glb, language.npz, points.ply and mesh.ply of one map.
plyfile reads PLY, gsply's C++ reader SPZ, trimesh glTF and meshes, NumPy the rest. Fails where two
files disagree, or where a damaged file is read without an error.
"""

import json
import struct
import sys
from pathlib import Path

import gsply_cpp
import numpy as np
import trimesh
from plyfile import PlyData

SH_0 = 0.28209479177387814


def columns(vertices, *names):
    return np.stack([np.asarray(vertices[name], np.float64) for name in names], axis=-1)


def unit(quaternions):
    return quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)


def same_rotations(a, b, least):
    return bool((np.abs((unit(a) * unit(b)).sum(-1)) > least).all())


def read_splats(path):
    vertices = PlyData.read(str(path))["vertex"].data
    return {
        "means": columns(vertices, "x", "y", "z"),
        "sh0": columns(vertices, "f_dc_0", "f_dc_1", "f_dc_2"),
        "opacity": 1 / (1 + np.exp(-np.asarray(vertices["opacity"], np.float64))),
        "log_scale": columns(vertices, "scale_0", "scale_1", "scale_2"),
        "rotation": columns(vertices, "rot_0", "rot_1", "rot_2", "rot_3"),
    }


def check_spz(path, splats):
    """SPZ against PLY; returns the largest difference of each attribute.

    SPZ's axes are right, up, back. It is lossy: tolerances are half a step of its quantisation.
    """
    read = gsply_cpp.read_spz(str(path))
    flip = np.array([1.0, -1.0, -1.0])

    opacity = 1 / (1 + np.exp(-read["opacities"].ravel()))
    log_scale = np.clip(splats["log_scale"], -10, 5.9375)
    color = np.clip(splats["sh0"], -10 / 3, 10 / 3)

    def differences(order):
        return {
            "metres": np.abs(read["means"] * flip - splats["means"][order]).max(),
            "log scale": np.abs(read["scales"] - log_scale[order]).max(),
            "opacity": np.abs(opacity - splats["opacity"][order]).max(),
            "color": np.abs(read["sh0"] - color[order]).max() * SH_0,
        }

    limits = {
        "metres": 0.6 / 4096,
        "log scale": 0.51 / 16,
        "opacity": 0.51 / 255,
        "color": 0.51 / 255 / 0.15 * SH_0,
    }
    count = len(splats["means"])
    found = differences(np.arange(count))
    message = f"SPZ against PLY: {found}, at most {limits}"
    assert all(found[key] <= limits[key] for key in limits), message
    turned = read["quats"] * np.array([1.0, 1.0, -1.0, -1.0])
    assert same_rotations(turned, splats["rotation"], 0.99999), "SPZ: rotations"
    # Negative controls: splats in another order differ, and half a file is refused.
    wrong = differences(np.roll(np.arange(count), 1))
    message = f"this comparison finds no difference: {wrong}"
    assert all(wrong[key] > limits[key] for key in limits), message
    half = path.with_suffix(".half.spz")
    half.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    try:
        gsply_cpp.read_spz(str(half))
    except Exception:
        return found
    raise AssertionError("half an SPZ file was read without an error")


def check_glb(path, splats):
    """glTF against PLY."""
    scene = trimesh.load(str(path))
    (name,) = scene.geometry
    (node,) = scene.graph.nodes_geometry
    turn, _ = scene.graph[node]
    turn = turn[:3, :3]
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0, turn
    # The room's z is up; glTF's is y.
    assert (turn @ [0, 0, 1])[1] > np.cos(np.radians(3)), f"glTF is y up: {turn}"
    assert np.allclose(scene.geometry[name].vertices, splats["means"], atol=1e-6), "glTF: positions"
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    assert "KHR_gaussian_splatting" in document["extensionsUsed"]
    primitive = document["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    assert primitive["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse"

    def attribute(name, parts):
        accessor = document["accessors"][primitive["attributes"]["KHR_gaussian_splatting:" + name]]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        assert accessor["type"] == {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[parts]
        values = np.frombuffer(binary, "<f4", accessor["count"] * parts, view["byteOffset"])
        return values.reshape(-1, parts)

    log_scale, opacity = np.log(attribute("SCALE", 3)), attribute("OPACITY", 1)[:, 0]
    assert np.allclose(log_scale, splats["log_scale"], atol=1e-5), "glTF: scales are linear"
    assert np.allclose(opacity, splats["opacity"], atol=1e-6), "glTF: opacities"
    color = attribute("SH_DEGREE_0_COEF_0", 3)
    assert np.allclose(color, splats["sh0"], atol=1e-6), "glTF: colors"
    rotation = np.roll(attribute("ROTATION", 4), 1, axis=-1)
    assert same_rotations(rotation, splats["rotation"], 0.999999), "glTF: rotations are x, y, z, w"
    # Negative control: rotations of other splats.
    others = np.roll(rotation, 1, axis=0)
    assert not same_rotations(others, splats["rotation"], 0.999999), "no difference is found"


def check_language(path, splats):
    """Checks shapes and lengths; returns the share of splats that have language."""
    arrays = np.load(path)
    count = len(splats["means"])
    assert arrays["codes"].shape == (count, 15) and arrays["generic"].shape == (count, 32)
    described = np.any(arrays["codes"] != 0, axis=1)
    lengths = np.linalg.norm(arrays["generic"], axis=1)
    assert np.allclose(lengths[described], 1, atol=1e-3) and not lengths[~described].any()
    assert ((arrays["opacity"] >= 0) & (arrays["opacity"] <= 1)).all()
    assert arrays["rotation"].shape == (count, 4) and arrays["log_scale"].shape == (count, 3)
    return float(described.mean())


def check_mesh(path, splats):
    """Checks a mesh against the splats' extent; returns (triangles, area in m2)."""
    mesh = trimesh.load(str(path), process=False)
    vertices = PlyData.read(str(path))["vertex"].data
    assert len(mesh.faces) > 100 and mesh.faces.max() < len(mesh.vertices), "mesh: faces"
    low, high = splats["means"].min(0) - 0.2, splats["means"].max(0) + 0.2
    assert (mesh.vertices >= low).all() and (mesh.vertices <= high).all(), "the mesh leaves the map"
    relevancy = np.asarray(vertices["relevancy"])
    assert (relevancy >= 0).all() and (relevancy <= 1).all() and relevancy.std() > 0
    # Normals agree with the order of the triangles' vertices.
    given = columns(vertices, "nx", "ny", "nz")
    agree = (given * mesh.vertex_normals).sum(-1)
    assert np.median(agree) > 0.95, f"normals: {np.median(agree)}"
    return len(mesh.faces), float(mesh.area)


def main():
    folder = Path(sys.argv[1])
    splats = read_splats(folder / "splats.ply")
    worst = check_spz(folder / "splats.spz", splats)
    check_glb(folder / "splats.glb", splats)
    points = PlyData.read(str(folder / "points.ply"))["vertex"].data
    assert np.array_equal(columns(points, "x", "y", "z"), splats["means"])
    shown = np.clip(splats["sh0"] * SH_0 + 0.5, 0, 1) * 255
    assert np.abs(columns(points, "red", "green", "blue") - shown).max() < 0.51
    described = check_language(folder / "language.npz", splats)
    faces, area = check_mesh(folder / "mesh.ply", splats)
    print(
        f"{len(splats['means'])} splats agree in PLY, SPZ and glTF; {described:.0%} have language"
    )
    print("SPZ loses at most", ", ".join(f"{value:.2g} {key}" for key, value in worst.items()))
    print(f"mesh: {faces} triangles, {area:.1f} m2")


if __name__ == "__main__":
    main()
