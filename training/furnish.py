"""Furnished rooms from one seed, ray cast on the CPU: labelled frames with textures and clutter.

In:  photographs (texture patches), small object meshes with vertex colors (--objects) and the
     assets of a furnished house (--house: triangles, UVs, textures, instances; of the instances
     inside --skip-box neither shape nor texture is used).
Out: a folder per room in the Replica layout of `data.py`: results/, semantic/, instances.json,
     traj.txt (rows of world-from-camera, metres; x right, y down, z forward).

Built furniture (`furniture.py`) and some of the house's own stands along the walls and in the
middle, small things on what has a top. Kinds in HELD_OUT are left out unless --held-out.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from caster import Caster
from decor import Decor
from furniture import Kit
from shapes import COLOR, Part, Textures, box, cylinder, merge

# small objects by the beginning of their file's name
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
HELD_OUT = {
    "pear",
    "peach",
    "plum",
    "fork",
    "scissors",
    "stapler",
    "toothpaste",
    "marker",
    "shampoo",
    "glue",
    "clamp",
}
# classes of the house's instances that may stand on the floor, and on something
STANDING = {
    "sofa",
    "chair",
    "coffee table",
    "table",
    "tv cabinet",
    "shoe rack",
    "refrigerator",
    "trash can",
    "dumbbell",
    "weight bench",
    "air conditioner",
}
LYING = {"photo frame", "vase", "tableware", "tablet", "security camera"}
ALONG = [
    "bed",
    "nightstand",
    "cabinet",
    "wardrobe",
    "refrigerator",
    "tv_cabinet",
    "desk",
    "sofa",
    "bookcase",
    "trash_can",
    "floor_lamp",
    "plant",
    "chair",
]
CHANCES = [0.2, 0.06, 0.1, 0.13, 0.05, 0.06, 0.12, 0.1, 0.08, 0.03, 0.03, 0.02, 0.02]
HANGING = ["door", "window", "curtain", "air conditioner", "tv screen", "picture", "clock"]
ON_TOP = [
    "laptop",
    "screen",
    "monitor",
    "computer keyboard",
    "book",
    "lamp",
    "vase",
    "mug",
    "bottle",
    "cardboard box",
    "photo frame",
]


def read_house(folder, skip):
    """(textures, {class: [Part]}) of the instances whose centre is outside the box."""
    data = np.load(folder / "house.npz")
    points, faces, uvs = data["points"].astype(float), data["faces"], data["uv"]
    pieces, used = {}, {}
    for row in json.loads((folder / "instances.json").read_text()):
        centre = (np.array(row["aabb_min"]) + row["aabb_max"]) / 2
        mine = data["face_instance"] == row["id"]
        if (skip[0] < centre[0] < skip[2] and skip[1] < centre[1] < skip[3]) or not mine.any():
            continue
        texture = data["face_texture"][mine]
        number = np.array([used.setdefault(int(k), len(used)) for k in texture])
        if row["class"] in STANDING | LYING:
            index, inverse = np.unique(faces[mine], return_inverse=True)
            shift = np.array([centre[0], row["aabb_min"][1], row["aabb_min"][2]])
            pieces.setdefault(row["class"], []).append(
                Part(points[index] - shift, inverse.reshape(-1, 3), uvs[faces[mine]], number)
            )
    images = [
        np.asarray(
            Image.open(folder / f"textures/{k:03d}.jpg").convert("RGB").resize((192, 192)),
            np.float32,
        )
        for k in used
    ]
    return images, pieces


def read_objects(folder, held_out):
    """[(word, Part)] of the small meshes, feet at z = 0."""
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


class Room:
    """Things in a box room: `parts` with their words, and `aims` for the camera."""

    def __init__(self, textures, house, objects, random):
        self.kit, self.decor, self.r = Kit(textures), Decor(textures), random
        self.house, self.objects, self.lying = house, objects, []
        self.textures, self.parts, self.words, self.taken = textures, [], [], []
        self.tops, self.aims = [], []
        self.size = random.uniform([3.0, 3.0, 2.35], [6.0, 5.5, 2.9])
        self.shell()
        self.walls()
        self.middle()
        self.clutter()

    def add(self, word, part):
        self.parts.append(part)
        self.words.append(word)

    def shell(self):
        (a, b, c), t, thick = self.size / [2, 2, 1], self.textures, 0.05
        wall = t.plain() if self.r.random() < 0.7 else t.any()
        floor, scale = (t.wood() if self.r.random() < 0.5 else t.any()), self.r.uniform(0.5, 3)
        self.add("floor", box((-a, a), (-b, b), (-thick, 0), floor, scale))
        self.add("ceiling", box((-a, a), (-b, b), (c, c + thick), t.plain(), scale))
        sides = [
            box((-a, a), (-b - thick, -b), (0, c), wall, scale),
            box((-a, a), (b, b + thick), (0, c), wall, scale),
            box((-a - thick, -a), (-b, b), (0, c), wall, scale),
            box((a, a + thick), (-b, b), (0, c), wall, scale),
        ]
        self.add("wall", merge(sides))

    def free(self, low, high):
        """Takes the rectangle if nothing stands there."""
        if np.any(low < -self.size[:2] / 2 - 0.01) or np.any(high > self.size[:2] / 2 + 0.01):
            return False
        if any(np.all(low < far) and np.all(high > near) for near, far in self.taken):
            return False
        self.taken.append((low, high))
        return True

    def stand(self, made, turn, at):
        """Puts furniture with its back's middle at `at`; True if there was room."""
        word, part, top, width, depth, *extra = made
        c, s = np.cos(turn), np.sin(turn)
        corner = (
            np.array(
                [
                    [x * c - y * s, x * s + y * c]
                    for x in (-width / 2, width / 2)
                    for y in (0, depth)
                ]
            )
            + at
        )
        if not self.free(corner.min(0) + 0.005, corner.max(0) - 0.005):
            return False
        self.add(word, part.moved(turn, (*at, 0)))
        for extra_word, extra_part in extra[0] if extra else []:
            self.add(extra_word, extra_part.moved(turn, (*at, 0)))
        centre = part.moved(turn, (*at, 0)).points
        self.aims.append(((centre.min(0) + centre.max(0)) / 2, 0.9))
        if top:
            self.tops.append((np.array(at), turn, top, width, depth))
        return True

    def furniture(self):
        """Built, or now and then a piece of the house."""
        if self.r.random() < 0.25 and self.house:
            word = self.r.choice(sorted(STANDING & set(self.house)))
            part = self.house[word][self.r.integers(len(self.house[word]))]
            part = part.moved(0, (0, 0, 0), self.r.uniform(0.85, 1.1))
            if self.r.random() < 0.5:  # in another cloth
                part = Part(part.points, part.faces, part.uv, self.textures.cloth(), part.color)
            low, high = part.points.min(0), part.points.max(0)
            return word, part, high[2] if "table" in word else None, high[0] - low[0], high[1]
        return getattr(self.kit, self.r.choice(ALONG, p=CHANCES))()

    def walls(self):
        a, b, high = self.size / [2, 2, 1]
        ends = [
            (0, (0, -b), a),
            (np.pi / 2, (a, 0), b),
            (np.pi, (0, b), a),
            (-np.pi / 2, (-a, 0), b),
        ]
        for turn, middle, half in ends:
            along = np.array([np.cos(turn), np.sin(turn)])
            if self.r.random() < 0.9:
                self.decorate(turn, middle, half, along, high)
            x = -half + self.r.uniform(0.05, 0.4)
            while x < half - 0.4:
                made = self.furniture()
                at = middle + along * (x + made[3] / 2)
                if x + made[3] > half or not self.stand(made, turn, at):
                    x += 0.3
                    continue
                x += made[3] + 0.02
                if made[0] == "bed":
                    x = self.beside_bed(turn, middle, along, x, made)
                if made[0] in ("desk", "table") and self.r.random() < 0.8:
                    seat = self.kit.chair()
                    front = np.array([-np.sin(turn), np.cos(turn)]) * (made[4] + seat[4] * 0.8)
                    self.stand(seat, turn + np.pi, at + front)
                x += self.r.choice([0.05, 0.3, 0.8])

    def beside_bed(self, turn, middle, along, x, bed):
        """Nightstands to both sides, more often than not."""
        for side in (x - 0.02 - bed[3] - 0.04, x):
            if self.r.random() < 0.75:
                stand = self.kit.nightstand()
                shift = -stand[3] / 2 if side < x - 0.1 else stand[3] / 2 + 0.02
                if self.stand(stand, turn, middle + along * (side + shift)) and side == x:
                    x += stand[3] + 0.04
        return x

    def decorate(self, turn, middle, half, along, high):
        """Door, window, pictures ... in a row along the wall."""
        x = -half + self.r.uniform(0.2, 1.0)
        while x < half - 0.3:
            word = self.r.choice(HANGING, p=[0.2, 0.22, 0.08, 0.12, 0.12, 0.2, 0.06])
            part, width = self.decor.hanging(word)
            if x + width > half - 0.05 or part.points[:, 2].max() > high:
                x += 0.4
                continue
            at = middle + along * (x + width / 2)
            self.add(word, part.moved(turn, (*at, 0)))
            aim = part.moved(turn, (*at, 0)).points.mean(0)
            self.aims.append((aim, 0.7))
            if word == "window" and self.r.random() < 0.6:
                cloth = self.decor.hanging("curtain")[0]
                for side in (-1, 1):
                    self.add("curtain", cloth.moved(turn, (*(at + along * side * width / 2), 0)))
            x += width + self.r.uniform(0.1, 1.0)

    def middle(self):
        r = self.r
        if r.random() < 0.6:
            w, d = r.uniform(0.6, 1.5, 2)
            x, y = r.uniform(-0.5, 0.5, 2)
            rug = box((x - w, x + w), (y - d, y + d), (0, 0.012), self.textures.cloth(), 1.0)
            self.add(r.choice(["carpet", "rug"]), rug)
        if r.random() < 0.7:
            made = self.kit.table(r.choice(["table", "table", "coffee table"]))
            turn, at = r.uniform(0, 2 * np.pi), r.uniform(-0.7, 0.7, 2)
            front = np.array([-np.sin(turn), np.cos(turn)])
            if self.stand(made, turn, at) and made[0] == "table":
                for side in (-1, 1):
                    for x in (-0.3, 0.3):
                        seat = self.kit.chair()
                        spot = at + front * (made[4] / 2 + side * (made[4] / 2 + 0.35))
                        spot = spot + np.array([np.cos(turn), np.sin(turn)]) * x
                        if r.random() < 0.6:
                            self.stand(seat, turn + (np.pi if side > 0 else 0), spot)
        high = self.size[2]
        if r.random() < 0.7:
            drop, wide, x = r.uniform(0.1, 0.7), r.uniform(0.1, 0.35), r.uniform(-1, 1, 2)
            lamp = [
                cylinder(0.012, (high - drop, high), self.textures.plain(), at=x),
                cylinder(
                    wide,
                    (high - drop - 0.15, high - drop),
                    self.textures.plain(),
                    top=wide * r.uniform(0.3, 1),
                    at=x,
                ),
            ]
            self.add("chandelier" if r.random() < 0.5 else "lamp", merge(lamp))

    def clutter(self):
        """Small things on tops."""
        r = self.r
        small = [(w, p) for w in LYING & set(self.house) for p in self.house[w]]
        for at, turn, top, width, depth in self.tops:
            for _ in range(r.integers(0, 3 + int(width * depth * 9))):
                draw = r.random()
                if draw < 0.5 or not self.objects:
                    word = r.choice(ON_TOP)
                    part = self.decor.desktop(word)
                elif draw < 0.9:
                    word, part = self.objects[r.integers(len(self.objects))]
                else:
                    word, part = small[r.integers(len(small))]
                    part = part.moved(shift=(0, -part.points[:, 1].mean(), 0))
                reach = np.abs(part.points[:, :2]).max()
                if reach * 2 > min(width, depth) + 0.15:
                    continue
                x = r.uniform(-1, 1) * max(width / 2 - reach, 0)
                y = depth / 2 + r.uniform(-1, 1) * max(depth / 2 - reach, 0)
                c, s = np.cos(turn), np.sin(turn)
                spot = np.array([at[0] + x * c - y * s, at[1] + x * s + y * c])
                box_ = (spot - reach * 0.7, spot + reach * 0.7)
                near = [
                    k
                    for k in self.lying
                    if np.all(box_[0] < k[1]) and np.all(box_[1] > k[0])
                ]
                if near:
                    continue
                self.lying = [*self.lying, box_]
                angle = turn + (r.uniform(-0.7, 0.7) if draw < 0.5 else r.uniform(0, 6.3))
                self.add(word, part.moved(angle, (*spot, top)))
                self.aims.append((np.array([*spot, top + 0.08]), 0.35))


def look_at(eye, target):
    """World from camera: x right, y down, z forward."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, eye
    return pose


def view(room, caster, random, near):
    """(pose, focal over width): a standing view, or one from near to a small thing."""
    for _ in range(60):
        aim, reach = room.aims[random.integers(len(room.aims))]
        half = room.size[:2] / 2 - 0.15
        if near and reach < 0.5:
            angle, far = random.uniform(0, 2 * np.pi), random.uniform(0.5, 1.3)
            eye = aim + far * np.array([np.cos(angle), np.sin(angle), random.uniform(0.3, 1.0)])
        elif not near:
            eye = np.array([*random.uniform(-half, half), random.uniform(0.9, 1.75)])
            aim = aim + random.normal(0, 0.4, 3)
        else:
            continue
        if np.any(np.abs(eye[:2]) > half) or not 0.3 < eye[2] < room.size[2] - 0.2:
            continue
        pose, focal = look_at(eye, aim), random.uniform(0.45, 1.0)
        _, ids, depth = caster.render(pose, 40, 30, focal * 40, 1)
        if (
            len(np.unique(ids)) > 3
            and (depth == 0).mean() < 0.02
            and np.percentile(depth, 10) > (0.3 if near else 0.7)
        ):
            return pose, focal
    return None


def write_room(folder, room, caster, random, args):
    """All views of one room."""
    for name in ("results", "semantic"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    rows = [{"id": k + 1, "class": str(word)} for k, word in enumerate(room.words)]
    (folder / "instances.json").write_text(json.dumps(rows))
    poses, seen = [], 0
    for number in range(args.views):
        found = view(room, caster, random, number % args.close == args.close - 1)
        if found is None:
            continue
        pose, focal = found
        rgb, ids, _ = caster.render(pose, args.width, args.height, focal * args.width, args.samples)
        Image.fromarray(rgb).save(folder / f"results/frame{seen:06d}.jpg", quality=90)
        Image.fromarray(ids).save(folder / f"semantic/{seen:06d}.png")
        poses.append(" ".join(f"{v:.6g}" for v in pose.ravel()))
        seen += 1
    (folder / "traj.txt").write_text("\n".join(poses) + "\n")
    return seen


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--house", type=Path, required=True, help="house.npz, textures/ ...")
    parser.add_argument(
        "--skip-box",
        type=float,
        nargs=4,
        required=True,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="take nothing from this box (m)",
    )
    parser.add_argument("--photos", type=Path, required=True, help="folder of photographs")
    parser.add_argument("--objects", type=Path, required=True, help="folder of PLY meshes")
    parser.add_argument("--held-out", action="store_true", help="place held-out kinds as well")
    parser.add_argument("--seeds", type=int, nargs=2, required=True, help="first and last + 1")
    parser.add_argument("--views", type=int, default=12, help="views of each room")
    parser.add_argument("--close", type=int, default=3, help="every n-th view is from near")
    parser.add_argument("--width", type=int, default=448)
    parser.add_argument("--height", type=int, default=336)
    parser.add_argument("--samples", type=int, default=1, help="rays per pixel and axis")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    images, pieces = read_house(args.house, args.skip_box)
    objects = read_objects(args.objects, args.held_out)
    for seed in range(*args.seeds):
        random = np.random.default_rng(seed)
        room = Room(Textures(args.photos, images, random), pieces, objects, random)
        seen = write_room(args.out / f"f{seed}", room, Caster(room, random), random, args)
        print(f"room {seed}: {len(room.parts)} things, {seen} views", flush=True)


if __name__ == "__main__":
    main()
