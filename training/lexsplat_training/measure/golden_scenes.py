"""Small random scenes of Gaussians for the renderer's reference pictures.

Conventions are the renderer's: pixel centres at integers, logarithms of scales, logits of
opacities. All values are f64 but exact in f32.
"""

import numpy as np
import torch

CHANNELS = 16  # of the language head
# size: standard deviations in pixels, log-uniform between the two; picture, codes: (width, height)
# of the color and language image; shift: of the principal point from the middle, in pixels; logits:
# range of the opacity logits
SCENES = {
    "one": {
        "seed": 4,
        "count": 1,
        "size": (1.5, 5),
        "picture": (32, 24),
        "codes": (16, 12),
        "shift": 0,
        "logits": (1, 1),
    },
    "forty": {
        "seed": 2,
        "count": 40,
        "size": (0.8, 4),
        "picture": (64, 48),
        "codes": (32, 24),
        "shift": 1.7,
        "logits": (-2, 4),
    },
    "crowd": {
        "seed": 3,
        "count": 300,
        "size": (0.4, 30),
        "picture": (96, 72),
        "codes": (32, 24),
        "shift": 0,
        "logits": (1, 4),
    },
}


def rotation_of(q):
    """Rotation matrix of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def camera(size, full, shift):
    """Intrinsics [fx, fy, cx, cy, width, height] of an image `size` of a camera of `full` size."""
    scale = np.array(size) / np.array(full)
    focal = np.array([0.9, 0.95]) * full[0] * scale
    border = (np.array(full) / 2 + shift) * scale  # from the image's border to the principal point
    return np.float32([*focal, *(border - 0.5), *size]).astype(np.float64)


def make(spec):
    """(parameters by name, pose, random generator) of a scene.

    pose: [qw qx qy qz tx ty tz] of camera_from_world.
    """
    rng = np.random.default_rng(spec["seed"])
    n, (width, height) = spec["count"], spec["picture"]
    z = rng.uniform(0.8, 4.0, n)
    reach = 0.25 if n == 1 else (0.45 if spec["shift"] else 0.75)
    side = np.array([1, height / width]) / 0.9 * reach
    means = np.concatenate([rng.uniform(-1, 1, (n, 2)) * side * z[:, None], z[:, None]], axis=1)
    if n > 100:
        means[:3, 2] = [-1.0, 0.05, 0.0995]  # behind the camera, and nearer than the near plane
    pose = np.array([1.0, 0.03, -0.02, 0.05, 0.02, -0.03, 0.05])
    pose[:4] /= np.linalg.norm(pose[:4])
    pose = np.float32(pose).astype(np.float64)
    rows = {"means": (means - pose[4:]) @ rotation_of(pose[:4])}
    metres = np.maximum(z, 0.8)[:, None] / (0.9 * width)  # per pixel
    for head, channels in (("color", 3), ("language", CHANNELS)):
        low, high = np.log(spec["size"])
        rows[f"{head}.rotations"] = rng.normal(size=(n, 4)) * rng.uniform(0.3, 3.0, (n, 1))
        pixels = np.exp(rng.uniform(low, high, (n, 3))) if n > 1 else np.array([[1.5, 3.0, 5.0]])
        rows[f"{head}.log_scales"] = np.log(metres * pixels)
        rows[f"{head}.opacity_logits"] = rng.uniform(*spec["logits"], n)
        rows[f"{head}.features"] = rng.uniform(0, 1, (n, channels))
    rows = {k: torch.from_numpy(np.float32(v).astype(np.float64)) for k, v in rows.items()}
    return rows, pose, rng


def view_matrix(pose, tau):
    """[4, 4] of Exp(tau) camera_from_world, for a twist tau = [rho, theta]."""
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = rotation_of(pose[:4]), pose[4:]
    zero = torch.zeros((), dtype=tau.dtype)
    (a, b, c), (x, y, z) = tau[:3], tau[3:]
    rows = [[zero, -z, y, a], [z, zero, -x, b], [-y, x, zero, c], [zero] * 4]
    twist = torch.stack([torch.stack(row) for row in rows])
    return torch.linalg.matrix_exp(twist) @ torch.from_numpy(start)
