"""Camera poses in a room."""

import numpy as np


def look_at(eye, target):
    """World-from-camera [4, 4] of a camera at `eye` that looks at `target`.

    Camera axes: x right, y down, z forward.
    """
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, eye
    return pose


def random_view(room, caster, random, near):
    """(pose, focal length over image width) of a random view; None if 60 tries find none.

    `near`: a view of a small object from 0.5 to 1.3 m, otherwise one from standing height. A view
    counts if it shows at least four objects, almost no hole, and nothing too close.
    """
    half = room.size[:2] / 2 - 0.15
    for _ in range(60):
        aim, size = room.aims[random.integers(len(room.aims))]
        if near and size < 0.5:
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
        holes, closest = (depth == 0).mean(), np.percentile(depth, 10)
        if len(np.unique(ids)) > 3 and holes < 0.02 and closest > (0.3 if near else 0.7):
            return pose, focal
    return None
