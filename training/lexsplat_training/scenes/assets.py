"""Meshes read from disk: pieces of a furnished house, and small objects."""

import json

import numpy as np
import trimesh
from PIL import Image

from .part import COLOR, Part

# word of a small object, by the beginning of its file's name
KINDS = {
    "black_marker": "marker",
    "blue_marker": "marker",
    "large_marker": "marker",
    "red_marker": "marker",
    "small_marker": "marker",
    "blue_cup": "cup",
    "green_cup": "cup",
    "orange_cup": "cup",
    "yellow_cup": "cup",
    "conditioner": "bottle",
    "doraemon_bowl": "bowl",
    "repellent": "bottle",
    "shampoo": "shampoo",
    "fork": "fork",
    "spoon": "spoon",
    "knife": "knife",
    "glue": "glue",
    "flat_screwdriver": "screwdriver",
    "phillips_screwdriver": "screwdriver",
    "large_clamp": "clamp",
    "medium_clamp": "clamp",
    "small_clamp": "clamp",
    "mini_claw_hammer": "hammer",
    "plastic_apple": "apple",
    "plastic_banana": "banana",
    "plastic_lemon": "lemon",
    "plastic_orange": "orange",
    "plastic_peach": "peach",
    "plastic_pear": "pear",
    "plastic_plum": "plum",
    "remote_controller": "remote control",
    "scissors": "scissors",
    "soap": "soap",
    "stapler": "stapler",
    "suger": "cardboard box",
    "orion_pie": "cardboard box",
    "toothpaste": "toothpaste",
}
# words of small objects that no training room shows
HELD_OUT = {
    "pear", "peach", "plum", "fork", "scissors", "stapler", "toothpaste", "marker", "shampoo",
    "glue", "clamp",
}  # fmt: skip
# classes of the house that may stand on the floor
STANDING = {
    "sofa", "chair", "coffee table", "table", "tv cabinet", "shoe rack", "refrigerator",
    "trash can", "dumbbell", "weight bench", "air conditioner",
}  # fmt: skip
# classes of the house that may lie on a table
LYING = {"photo frame", "vase", "tableware", "tablet", "security camera"}
TEXTURE_SIDE = 192  # pixels of the house's textures here


def read_house(folder, skip):
    """(textures, {class: [Part]}) of a house's instances in STANDING or LYING.

    Instances with their centre inside the box `skip` (x0, y0, x1, y1 in metres) are left out, with
    their textures. A part's back is at y = 0, its foot at z = 0, x is centred.
    """
    data = np.load(folder / "house.npz")
    points, faces, uvs = data["points"].astype(float), data["faces"], data["uv"]
    pieces, used = {}, {}
    for row in json.loads((folder / "instances.json").read_text()):
        centre = (np.array(row["aabb_min"]) + row["aabb_max"]) / 2
        mine = data["face_instance"] == row["id"]
        skipped = skip[0] < centre[0] < skip[2] and skip[1] < centre[1] < skip[3]
        if skipped or not mine.any():
            continue
        texture = data["face_texture"][mine]
        number = np.array([used.setdefault(int(k), len(used)) for k in texture])
        if row["class"] in STANDING | LYING:
            index, inverse = np.unique(faces[mine], return_inverse=True)
            shift = np.array([centre[0], row["aabb_min"][1], row["aabb_min"][2]])
            part = Part(points[index] - shift, inverse.reshape(-1, 3), uvs[faces[mine]], number)
            pieces.setdefault(row["class"], []).append(part)
    return [read_texture(folder / f"textures/{k:03d}.jpg") for k in used], pieces


def read_texture(path):
    """float32 [TEXTURE_SIDE, TEXTURE_SIDE, 3]"""
    picture = Image.open(path).convert("RGB").resize((TEXTURE_SIDE, TEXTURE_SIDE))
    return np.asarray(picture, np.float32)


def read_objects(folder, held_out):
    """[(word, Part)] of the PLY meshes named in KINDS, centred, feet at z = 0.

    Words in HELD_OUT are read only if `held_out`.
    """
    found = []
    for path in sorted(folder.glob("*.ply")):
        word = next((w for k, w in KINDS.items() if path.stem.startswith(k)), None)
        if word is None or (word in HELD_OUT and not held_out):
            continue
        mesh = trimesh.load(path, process=False)
        low, high = mesh.bounds
        points = mesh.vertices - [*(low + high)[:2] / 2, low[2]]
        color = np.asarray(mesh.visual.vertex_colors)[:, :3][mesh.faces].mean(1)
        uv = np.zeros((len(mesh.faces), 3, 2))
        found.append((word, Part(np.asarray(points), np.asarray(mesh.faces), uv, COLOR, color)))
    return found
