"""A ray caster for rooms (CPU, Embree) with mip-mapped textures."""

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from .part import merge


def mip_chain(image):
    """The image and its successive halves, down to one pixel in height or width."""
    chain = [image]
    while min(chain[-1].shape[:2]) > 1:
        a = chain[-1]
        a = a[: a.shape[0] // 2 * 2, : a.shape[1] // 2 * 2]
        chain.append((a[::2, ::2] + a[1::2, ::2] + a[::2, 1::2] + a[1::2, 1::2]) / 4)
    return chain


class Caster:
    """Renders a `Room` with two distant lights and one lamp in the room, drawn from `random`.

    No shadows, no reflections.
    """

    def __init__(self, room, random):
        whole = merge(room.parts)
        self.ids = np.repeat(np.arange(1, len(room.parts) + 1), [len(p.faces) for p in room.parts])
        self.part = whole
        corners = whole.points[whole.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normal, axis=1)
        self.normals = normal / np.maximum(area, 1e-12)[:, None]
        lights = random.normal(0, 1, (2, 3)) + np.array([0, 0, 1.2])
        lights /= np.linalg.norm(lights, axis=1, keepdims=True)
        a, b = random.uniform(0.1, 0.4), random.uniform(0.05, 0.3)
        first, second = np.abs(self.normals @ lights[0]), np.abs(self.normals @ lights[1])
        self.shade = (1 - a - b) + a * first + b * second
        self.lamp = np.array([*random.uniform(-1, 1, 2), room.size[2] - 0.3])
        self.glow, self.tint = random.uniform(0, 0.6), random.normal(1, 0.06, 3)
        used = np.unique(whole.texture)
        self.mips = {k: mip_chain(room.textures.images[k]) for k in used if k >= 0}
        edge = whole.uv[:, 1:] - whole.uv[:, :1]
        uv_area = np.abs(edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0])
        texels = np.array([self.mips[k][0].shape[0] if k >= 0 else 1 for k in whole.texture])
        self.density = np.sqrt(uv_area / np.maximum(area, 1e-12)) * texels  # texels per metre
        self.rays = RayMeshIntersector(trimesh.Trimesh(whole.points, whole.faces, process=False))

    def cast(self, origin, directions):
        """(hit [n] bool, face [hits], distance [hits] in metres) along unit vectors [n, 3]."""
        origins = np.repeat(origin[None], len(directions), 0)
        found = self.rays.intersects_first(origins, directions)
        hit = found >= 0
        face = found[hit]
        normal = self.normals[face]
        slope = (directions[hit] * normal).sum(1)
        slope = np.where(np.abs(slope) < 1e-9, 1e-9, slope)
        corner = self.part.points[self.part.faces[face, 0]]
        return hit, face, ((corner - origin) * normal).sum(1) / slope

    def colors(self, face, place, footprint):
        """Texture colors [n, 3] of points on faces; `footprint`: texels that a pixel covers."""
        a, b, c = np.moveaxis(self.part.points[self.part.faces[face]], 1, 0)
        weights = trimesh.triangles.points_to_barycentric(np.stack([a, b, c], 1), place)
        uv = np.nan_to_num((self.part.uv[face] * weights[..., None]).sum(1))
        level = np.log2(np.maximum(footprint, 1)).round().astype(int)
        color = self.part.color[face].astype(np.float32)
        texture = self.part.texture[face]
        for k in np.unique(texture[texture >= 0]):
            mine = np.flatnonzero(texture == k)
            for fine in np.unique(level[mine]):
                some = mine[level[mine] == fine]
                image = self.mips[k][min(fine, len(self.mips[k]) - 1)]
                side = np.array(image.shape[1::-1])
                i, j = (np.floor(uv[some] * [1, -1] % 1 * side).astype(int) % side).T
                color[some] = image[j, i]
        return color

    def render(self, pose, width, height, focal, samples=2):
        """(rgb uint8 [height, width, 3], id uint16 [height, width], distance [height, width]).

        pose: world-from-camera [4, 4]; focal: pixels; samples: rays per pixel along each axis. The
        id is the object's place in the room's list plus 1; id and distance are 0 where nothing is.
        """
        w, h = width * samples, height * samples
        x, y = np.meshgrid((np.arange(w) + 0.5) / samples, (np.arange(h) + 0.5) / samples)
        ray = np.stack([(x - width / 2) / focal, (y - height / 2) / focal, np.ones_like(x)], -1)
        ray = ray.reshape(-1, 3) @ pose[:3, :3].T
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        hit, face, far = self.cast(pose[:3, 3], ray)
        place = pose[:3, 3] + ray[hit] * far[:, None]
        slant = np.abs((self.normals[face] * ray[hit]).sum(1)).clip(0.15, 1)
        footprint = far / (focal * samples) / np.sqrt(slant) * self.density[face]
        color = self.colors(face, place, footprint)
        near = np.linalg.norm(place - self.lamp, axis=1)
        light = self.shade[face] * (1 - self.glow / 2 + self.glow * 1.2 / (0.4 + near / 2))
        rgb = np.zeros((len(ray), 3), np.float32)
        rgb[hit] = color * light[:, None] * self.tint
        ids, depth = np.zeros(len(ray), np.uint16), np.zeros(len(ray))
        ids[hit], depth[hit] = self.ids[face], far
        rgb = rgb.reshape(height, samples, width, samples, 3).mean((1, 3)).clip(0, 255)
        pick = (slice(None, None, samples),) * 2
        return rgb.astype(np.uint8), ids.reshape(h, w)[pick], depth.reshape(h, w)[pick]
