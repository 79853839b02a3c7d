"""Opens a map's files with programs that others made for viewing splats.

    PYTHONPATH=.deps/readers python3 tests/outside/viewers.py FOLDER NODE_MODULES

The folder has minus_y_splats.ply (-y up, as splat viewers take PLY), y.spz and y.glb of one map,
and map.ply (the map's own coordinates, which are tilted). Khronos' validator reads y.glb.
PlayCanvas' splat-transform turns the other files into glTF, where y is up: heights must be those
of y.glb.
"""

import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np

EXTENSION = "KHR_gaussian_splatting"
# SPZ is lossy, and floors are fitted to a part of the points.
METRES = 0.02
VALIDATE = """
import { createRequire } from 'module';
import fs from 'fs';
const validator = createRequire(process.argv[1] + '/')('gltf-validator');
const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])));
console.log(JSON.stringify(report.issues.messages));
"""


def run(*command):
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def read_glb(path):
    """The document, and the positions in the world of the scene."""
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    document = json.loads(data[20 : 20 + length])
    binary = data[28 + length :]
    (primitive,) = document["meshes"][0]["primitives"]
    accessor = document["accessors"][primitive["attributes"]["POSITION"]]
    view = document["bufferViews"][accessor["bufferView"]]
    start = view["byteOffset"]
    points = np.frombuffer(binary[start : start + view["byteLength"]], "<f4").reshape(-1, 3)
    x, y, z, w = document["nodes"][0].get("rotation", [0, 0, 0, 1])
    axis = np.array([x, y, z])
    turned = points + 2 * np.cross(axis, np.cross(axis, points) + w * points)
    return document, turned


def faults(modules, path):
    """What the validator says, less that it does not know the extension and its attributes."""
    messages = json.loads(run("node", "--input-type=module", "-e", VALIDATE, modules, str(path)))

    def is_known(message):
        unknown = message["code"] == "UNSUPPORTED_EXTENSION" and EXTENSION in message["message"]
        attribute = f"/attributes/{EXTENSION}:" in message["pointer"]
        return unknown or (attribute and message["code"] == "MESH_PRIMITIVE_INVALID_ATTRIBUTE")

    return [message for message in messages if not is_known(message)]


def check_document(ours, theirs):
    """Both writers say the same of the Gaussians."""

    def said(document):
        (primitive,) = document["meshes"][0]["primitives"]
        kinds = {}
        for name, at in primitive["attributes"].items():
            accessor = document["accessors"][at]
            keys = ("type", "componentType", "normalized", "count")
            kinds[name] = [accessor.get(key) for key in keys]
        return document["extensionsUsed"], primitive["mode"], primitive["extensions"], kinds

    assert said(ours) == said(theirs), f"{said(ours)} against {said(theirs)}"


def heights(points):
    return np.quantile(points[:, 1], [0.001, 0.1, 0.5, 0.9, 0.999])


def main():
    folder, modules = Path(sys.argv[1]), sys.argv[2]
    glb = folder / "y.glb"
    assert faults(modules, glb) == [], faults(modules, glb)
    # Negative control: a document that promises more than it has.
    document, points = read_glb(glb)
    broken = folder / "broken.glb"
    count = str(len(points)).encode()
    more = b'"count":' + b"9" * len(count)
    broken.write_bytes(glb.read_bytes().replace(b'"count":' + count, more))
    assert faults(modules, broken) != [], "the validator sees no fault in a broken file"

    def opened(name):
        out = folder / f"{name}.glb"
        tool = f"{modules}/.bin/splat-transform"
        run(tool, "--overwrite", str(folder / name), str(out))
        return read_glb(out)

    theirs, upright = opened("minus_y_splats.ply")
    check_document(document, theirs)
    for name, turned in (("PLY", upright), ("SPZ", opened("y.spz")[1])):
        assert len(turned) == len(points), name
        off = np.abs(heights(turned) - heights(points)).max()
        assert off < METRES, f"{name} stands {off} m otherwise than glTF"
        print(f"{name}: heights within {off * 1000:.1f} mm of those of glTF")
    # Negative control: the map's own coordinates are tilted.
    off = np.abs(heights(opened("map.ply")[1]) - heights(points)).max()
    assert off > 10 * METRES, "this test does not see that a map is tilted"


if __name__ == "__main__":
    main()
