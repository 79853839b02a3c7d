"""A box-shaped room filled with furniture, wall decoration and small objects at random."""

import numpy as np

from . import furniture, storage, wall_decor
from .assets import LYING, STANDING
from .carpentry import Piece
from .part import Part, box, cylinder, merge
from .tabletop import on_top


def direction(turn):
    """The horizontal unit vector at the angle `turn`."""
    return np.array([np.cos(turn), np.sin(turn)])


def front(turn):
    """Where furniture that is turned by `turn` faces."""
    return np.array([-np.sin(turn), np.cos(turn)])


class Wall:
    """One of the four walls: furniture on it is turned by `turn`."""

    def __init__(self, turn, middle, half):
        self.turn, self.middle, self.half = turn, middle, half  # half: half its length
        self.along = direction(turn)

    def at(self, x):
        """The point on the floor `x` metres along the wall from its middle."""
        return self.middle + self.along * x


class Room:
    """Objects in a room.

    size: metres along x, y, z; x and y are centred on 0. parts, words: the objects and what they
    are called. aims: [(point, size)] for the camera, where the size of small objects is 0.35.
    """

    def __init__(self, textures, house, objects, random):
        """`house`, `objects`: see `assets`; `random`: the generator that `textures` uses too."""
        self.textures, self.house, self.objects, self.random = textures, house, objects, random
        self.parts, self.words, self.aims = [], [], []
        self.taken = []  # (low, high) corners of occupied floor
        self.tops = []  # (piece, turn, at) of furniture with a free top
        self.lying = []  # (low, high) corners of small objects seen from above
        self.size = random.uniform([3.0, 3.0, 2.35], [6.0, 5.5, 2.9])
        self.shell()
        self.walls()
        self.middle()
        self.clutter()

    def add(self, word, part):
        self.parts.append(part)
        self.words.append(word)

    def shell(self):
        """Floor, ceiling and walls."""
        (a, b, c), textures, thick = self.size / [2, 2, 1], self.textures, 0.05
        wall = textures.plain() if self.random.random() < 0.7 else textures.any()
        floor = textures.wood() if self.random.random() < 0.5 else textures.any()
        scale = self.random.uniform(0.5, 3)
        self.add("floor", box((-a, a), (-b, b), (-thick, 0), floor, scale))
        self.add("ceiling", box((-a, a), (-b, b), (c, c + thick), textures.plain(), scale))
        sides = [
            box((-a, a), (-b - thick, -b), (0, c), wall, scale),
            box((-a, a), (b, b + thick), (0, c), wall, scale),
            box((-a - thick, -a), (-b, b), (0, c), wall, scale),
            box((a, a + thick), (-b, b), (0, c), wall, scale),
        ]
        self.add("wall", merge(sides))

    def claim(self, low, high):
        """Takes a rectangle of the floor; False if it is occupied or outside of the room."""
        if np.any(low < -self.size[:2] / 2 - 0.01) or np.any(high > self.size[:2] / 2 + 0.01):
            return False
        if any(np.all(low < far) and np.all(high > near) for near, far in self.taken):
            return False
        self.taken.append((low, high))
        return True

    def stand(self, piece, turn, at):
        """Puts furniture down with the middle of its back at `at`; False if there is no space."""
        c, s = np.cos(turn), np.sin(turn)
        x, y = (-piece.width / 2, piece.width / 2), (0, piece.depth)
        corners = np.array([[a * c - b * s, a * s + b * c] for a in x for b in y]) + at
        if not self.claim(corners.min(0) + 0.005, corners.max(0) - 0.005):
            return False
        part = piece.part.moved(turn, (*at, 0))
        self.add(piece.word, part)
        for word, content in piece.contents:
            self.add(word, content.moved(turn, (*at, 0)))
        self.aims.append(((part.points.min(0) + part.points.max(0)) / 2, 0.9))
        if piece.top:
            self.tops.append((piece, turn, np.array(at)))
        return True

    def furniture(self):
        """A built piece of furniture, or one of the house's."""
        if self.random.random() < 0.25 and self.house:
            word = self.random.choice(sorted(STANDING & set(self.house)))
            part = self.house[word][self.random.integers(len(self.house[word]))]
            part = part.moved(0, (0, 0, 0), self.random.uniform(0.85, 1.1))
            if self.random.random() < 0.5:  # with another texture
                part = Part(part.points, part.faces, part.uv, self.textures.cloth(), part.color)
            low, high = part.points.min(0), part.points.max(0)
            top = high[2] if "table" in word else None
            return Piece(word, part, high[0] - low[0], high[1], top)
        return furniture.along_walls(self.textures)

    def walls(self):
        """Decoration and furniture along the four walls."""
        a, b, _ = self.size / [2, 2, 1]
        for wall in (
            Wall(0, (0, -b), a),
            Wall(np.pi / 2, (a, 0), b),
            Wall(np.pi, (0, b), a),
            Wall(-np.pi / 2, (-a, 0), b),
        ):
            if self.random.random() < 0.9:
                self.decorate(wall)
            self.furnish(wall)

    def furnish(self, wall):
        """Furniture in a row along a wall."""
        x = -wall.half + self.random.uniform(0.05, 0.4)
        while x < wall.half - 0.4:
            piece = self.furniture()
            at = wall.at(x + piece.width / 2)
            if x + piece.width > wall.half or not self.stand(piece, wall.turn, at):
                x += 0.3
                continue
            x += piece.width + 0.02
            if piece.word == "bed":
                x = self.beside_bed(wall, x, piece)
            if piece.word in ("desk", "table") and self.random.random() < 0.8:
                seat = furniture.chair(self.textures)
                away = front(wall.turn) * (piece.depth + seat.depth * 0.8)
                self.stand(seat, wall.turn + np.pi, at + away)
            x += self.random.choice([0.05, 0.3, 0.8])

    def beside_bed(self, wall, x, bed):
        """By chance nightstands on both sides of a bed that ends at `x`; the new end."""
        for side in (x - 0.02 - bed.width - 0.04, x):
            if self.random.random() < 0.75:
                piece = storage.nightstand(self.textures)
                left = side < x - 0.1
                shift = -piece.width / 2 if left else piece.width / 2 + 0.02
                if self.stand(piece, wall.turn, wall.at(side + shift)) and side == x:
                    x += piece.width + 0.04
        return x

    def decorate(self, wall):
        """Doors, windows, pictures in a row along a wall."""
        x = -wall.half + self.random.uniform(0.2, 1.0)
        while x < wall.half - 0.3:
            word, part, width = wall_decor.hanging(self.textures)
            if x + width > wall.half - 0.05 or part.points[:, 2].max() > self.size[2]:
                x += 0.4
                continue
            at = wall.at(x + width / 2)
            part = part.moved(wall.turn, (*at, 0))
            self.add(word, part)
            self.aims.append((part.points.mean(0), 0.7))
            if word == "window" and self.random.random() < 0.6:
                cloth, _ = wall_decor.curtain(self.textures)
                for side in (-1, 1):
                    end = at + wall.along * side * width / 2
                    self.add("curtain", cloth.moved(wall.turn, (*end, 0)))
            x += width + self.random.uniform(0.1, 1.0)

    def middle(self):
        """A rug, a table with chairs and a lamp in the middle of the room, each by chance."""
        r = self.random
        if r.random() < 0.6:
            w, d = r.uniform(0.6, 1.5, 2)
            x, y = r.uniform(-0.5, 0.5, 2)
            cloth = self.textures.cloth()
            rug = box((x - w, x + w), (y - d, y + d), (0, 0.012), cloth, 1.0)
            self.add(r.choice(["carpet", "rug"]), rug)
        if r.random() < 0.7:
            table = furniture.table(self.textures, r.choice(["table", "table", "coffee table"]))
            turn, at = r.uniform(0, 2 * np.pi), r.uniform(-0.7, 0.7, 2)
            if self.stand(table, turn, at) and table.word == "table":
                self.seat_around(table, turn, at)
        if r.random() < 0.7:
            self.hang_lamp()

    def seat_around(self, table, turn, at):
        """Up to four chairs at a table."""
        for side in (-1, 1):
            for x in (-0.3, 0.3):
                chair = furniture.chair(self.textures)
                spot = at + front(turn) * (table.depth / 2 + side * (table.depth / 2 + 0.35))
                spot = spot + direction(turn) * x
                if self.random.random() < 0.6:
                    self.stand(chair, turn + (np.pi if side > 0 else 0), spot)

    def hang_lamp(self):
        """A lamp on a rod from the ceiling."""
        r, high, textures = self.random, self.size[2], self.textures
        drop, wide, at = r.uniform(0.1, 0.7), r.uniform(0.1, 0.35), r.uniform(-1, 1, 2)
        rod = cylinder(0.012, (high - drop, high), textures.plain(), at=at)
        z, cloth = (high - drop - 0.15, high - drop), textures.plain()
        shade = cylinder(wide, z, cloth, top=wide * r.uniform(0.3, 1), at=at)
        self.add("chandelier" if r.random() < 0.5 else "lamp", merge([rod, shade]))

    def clutter(self):
        """Small objects on tops."""
        small = [(w, part) for w in sorted(LYING & set(self.house)) for part in self.house[w]]
        for piece, turn, at in self.tops:
            for _ in range(self.random.integers(0, 3 + int(piece.width * piece.depth * 9))):
                self.put(small, piece, turn, at)

    def put(self, small, piece, turn, at):
        """One built object, scanned object or object of the house on a piece of furniture.

        It is left out if it is too large for the top or would touch another.
        """
        r, draw = self.random, self.random.random()
        if draw < 0.5 or not self.objects:
            word, part = on_top(self.textures)
        elif draw < 0.9 or not small:
            word, part = self.objects[r.integers(len(self.objects))]
        else:
            word, part = small[r.integers(len(small))]
            part = part.moved(shift=(0, -part.points[:, 1].mean(), 0))
        reach = np.abs(part.points[:, :2]).max()
        if reach * 2 > min(piece.width, piece.depth) + 0.15:
            return
        x = r.uniform(-1, 1) * max(piece.width / 2 - reach, 0)
        y = piece.depth / 2 + r.uniform(-1, 1) * max(piece.depth / 2 - reach, 0)
        c, s = np.cos(turn), np.sin(turn)
        spot = np.array([at[0] + x * c - y * s, at[1] + x * s + y * c])
        low, high = spot - reach * 0.7, spot + reach * 0.7
        if any(np.all(low < far) and np.all(high > near) for near, far in self.lying):
            return
        self.lying.append((low, high))
        angle = turn + (r.uniform(-0.7, 0.7) if draw < 0.5 else r.uniform(0, 6.3))
        self.add(word, part.moved(angle, (*spot, piece.top)))
        self.aims.append((np.array([*spot, piece.top + 0.08]), 0.35))
