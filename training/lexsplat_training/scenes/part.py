"""Textured triangle meshes: boxes, boxes with a picture and cylinders.

Lengths are in metres, z points up.
"""

import numpy as np
import trimesh

COLOR = -1  # texture number of a face that has a color of its own


class Part:
    """The triangles of one object.

    points [P, 3] in metres; faces [F, 3] index points; uv [F, 3, 2]; texture [F] indexes
    `Textures.images` (or is COLOR); color [F, 3] in 0..255 counts where texture is COLOR.
    """

    def __init__(self, points, faces, uv, texture, color=None):
        self.points, self.faces, self.uv = points, faces, uv
        self.texture = np.broadcast_to(texture, len(faces))
        self.color = np.zeros((len(faces), 3)) if color is None else color

    def moved(self, turn=0.0, shift=(0, 0, 0), scale=1.0):
        """A copy scaled, turned about z by `turn` radians, then shifted by `shift` metres."""
        c, s = np.cos(turn), np.sin(turn)
        points = self.points * scale @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + shift
        return Part(points, self.faces, self.uv, self.texture, self.color)


def merge(parts):
    """All triangles of several parts as one part."""
    starts = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    return Part(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([part.texture for part in parts]),
        np.concatenate([part.color for part in parts]),
    )


def span(width):
    """(from, to) of an interval centred on 0."""
    return -width / 2, width / 2


def box(x, y, z, texture, scale=1.0):
    """An axis-aligned box. x, y, z are (from, to); the texture repeats every `scale` metres."""
    corner = np.array([[a, b, c] for a in x for b in y for c in z], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces, uv = [], []
    for side, quad in enumerate(quads):
        axes = [(1, 2), (0, 2), (0, 1)][side // 2]
        for triangle in (quad[:3], (quad[0], quad[2], quad[3])):
            faces.append(triangle)
            uv.append(corner[list(triangle)][:, axes] / scale)
    return Part(corner, np.array(faces), np.array(uv), texture)


def image_box(x, y, z, frame, picture):
    """A flat box with the texture `frame`; its front (+y) shows the whole texture `picture`."""
    part = box(x, y, z, frame)
    textures = part.texture.copy()
    front = slice(6, 8)
    textures[front] = picture
    corners = part.points[part.faces[front]]
    low, high = part.points.min(0), part.points.max(0)
    part.uv[front] = ((corners - low) / (high - low))[..., [0, 2]] * 0.98 + 0.01
    return Part(part.points, part.faces, part.uv, textures)


def cylinder(radius, z, texture, top=None, at=(0, 0), sides=14):
    """An upright cylinder from z[0] to z[1] around `at`, or a cone with the radius `top` above."""
    mesh = trimesh.creation.cylinder(radius, 1.0, sections=sides)
    points = mesh.vertices.copy()
    if top is not None:
        points[points[:, 2] > 0, :2] *= top / radius
    points[:, 2] = (points[:, 2] + 0.5) * (z[1] - z[0]) + z[0]
    points[:, :2] += at
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    uv = np.stack([angle / np.pi, points[:, 2] * 2], -1)[mesh.faces]
    return Part(points, mesh.faces, uv, texture)
