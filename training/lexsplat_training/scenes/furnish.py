"""Render labelled frames of furnished rooms, one room per seed, ray cast on the CPU.

Built furniture and pieces of a given house stand along the walls and in the middle, small objects
on tables. Writes one folder per room in Replica layout: results/frame%06d.jpg,
semantic/%06d.png (instance ids), instances.json and traj.txt (world-from-camera in metres; camera
axes x right, y down, z forward).
"""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from ..command_line import parser
from .assets import read_house, read_objects
from .camera import random_view
from .caster import Caster
from .room import Room
from .textures import Textures

EXAMPLE = """\
--house house-assets --skip-box -9.5 -1.6 -2.2 3.3 \\
      --photos imagenet-samples --objects household-objects --seeds 5000 5010 --out furnished"""


def write_room(folder, room, caster, random, args):
    """Renders all views of one room; returns how many there are."""
    for name in ("results", "semantic"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    rows = [{"id": k + 1, "class": str(word)} for k, word in enumerate(room.words)]
    (folder / "instances.json").write_text(json.dumps(rows))
    poses = []
    for number in range(args.views):
        found = random_view(room, caster, random, number % args.close == args.close - 1)
        if found is None:
            continue
        pose, focal = found
        rgb, ids, _ = caster.render(pose, args.width, args.height, focal * args.width, args.samples)
        Image.fromarray(rgb).save(folder / f"results/frame{len(poses):06d}.jpg", quality=90)
        Image.fromarray(ids).save(folder / f"semantic/{len(poses):06d}.png")
        poses.append(" ".join(f"{v:.6g}" for v in pose.ravel()))
    (folder / "traj.txt").write_text("\n".join(poses) + "\n")
    return len(poses)


def arguments_parser():
    arguments = parser("furnish", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--house", type=Path, required=True, help="folder: house.npz, instances.json, textures/")
    add(
        "--skip-box",
        type=float,
        nargs=4,
        required=True,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="use nothing of the house inside this box (metres)",
    )
    add("--photos", type=Path, required=True, help="folder of photographs, for textures")
    add("--objects", type=Path, required=True, help="folder of small PLY meshes")
    add("--held-out", action="store_true", help="place the kinds that training holds out, too")
    add("--seeds", type=int, nargs=2, required=True, help="first seed, and last seed + 1")
    add("--views", type=int, default=12, help="views of each room (default 12)")
    add("--close", type=int, default=3, help="every n-th view is close (default 3)")
    add("--width", type=int, default=448, help="pixels (default 448)")
    add("--height", type=int, default=336, help="pixels (default 336)")
    add("--samples", type=int, default=1, help="rays per pixel along each axis (default 1)")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    images, pieces = read_house(args.house, args.skip_box)
    objects = read_objects(args.objects, args.held_out)
    for seed in range(*args.seeds):
        random = np.random.default_rng(seed)
        room = Room(Textures(args.photos, images, random), pieces, objects, random)
        seen = write_room(args.out / f"f{seed}", room, Caster(room, random), random, args)
        print(f"room {seed}: {len(room.parts)} objects, {seen} views", flush=True)
