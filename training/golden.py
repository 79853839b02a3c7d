"""Pictures and gradients of small scenes from another implementation: gsplat's PyTorch reference.

Out: one safetensors file per scene under gpu/tests/golden/; gpu/tests/golden/README.md says what is
in it and how gsplat's conventions are brought to ours. Everything is computed in f64 from inputs
that are exact in f32, and stored in f32.

    python golden.py --out ../gpu/tests/golden     # packages: golden.lock

gsplat's file `cuda/_torch_impl.py` is loaded by itself: the rest of the package wants CUDA. Its
`accumulate` takes two functions from nerfacc, which has them for CUDA only; the two below do the
same in plain PyTorch. Which pairs of Gaussian and pixel are blended is decided here (gsplat asks
its CUDA extension): alpha >= 1/255, until the transmittance would fall below 1e-4.
"""

import argparse
import importlib.metadata
import importlib.util
import sys
import types
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save_file

CHANNELS = 16
MIN_ALPHA = 1 / 255
MIN_TRANSMITTANCE = 1e-4
NEAR, FAR, DILATION = 0.1, 1e6, 0.1
MARGIN = 3e-5  # least relative distance of any alpha or transmittance from its cut-off
PARAMETERS = ["means"] + [
    f"{head}.{kind}"
    for head in ("color", "language")
    for kind in ("rotations", "log_scales", "opacity_logits", "features")
]

# Sizes are standard deviations in pixels (log-uniform between the two), `shift` is how far the
# principal point lies from the middle, in pixels.
SCENES = {
    "one": dict(
        seed=4, count=1, size=(1.5, 5), picture=(32, 24), codes=(16, 12), shift=0, logits=(1, 1)
    ),
    "forty": dict(
        seed=2, count=40, size=(0.8, 4), picture=(64, 48), codes=(32, 24), shift=1.7, logits=(-2, 4)
    ),
    "crowd": dict(
        seed=3, count=300, size=(0.4, 30), picture=(96, 72), codes=(32, 24), shift=0, logits=(1, 4)
    ),
}


def weight_from_alpha(alphas, ray_indices, n_rays):
    """nerfacc's render_weight_from_alpha for a flat list: w_i = a_i prod_{j<i} (1 - a_j)."""
    first = torch.searchsorted(ray_indices, torch.arange(n_rays))
    place = torch.arange(len(alphas)) - first[ray_indices]
    dense = torch.zeros(n_rays, int(place.max()) + 1, dtype=alphas.dtype)
    dense = dense.index_put((ray_indices, place), alphas)
    through = torch.cumprod(1 - dense, dim=1)
    reaching = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    reaching = reaching[ray_indices, place]
    return alphas * reaching, reaching


def along_rays(weights, values, ray_indices, n_rays):
    """nerfacc's accumulate_along_rays: sums of weight times value per ray."""
    values = weights[:, None] if values is None else weights[:, None] * values
    empty = torch.zeros(n_rays, values.shape[1], dtype=values.dtype)
    return empty.index_add(0, ray_indices, values)


def load_gsplat():
    """gsplat's PyTorch reference without the rest of the package."""
    stand_in = types.ModuleType("nerfacc")
    stand_in.render_weight_from_alpha = weight_from_alpha
    stand_in.accumulate_along_rays = along_rays
    sys.modules["nerfacc"] = stand_in
    path = importlib.metadata.distribution("gsplat").locate_file("gsplat/cuda/_torch_impl.py")
    spec = importlib.util.spec_from_file_location("gsplat_torch_impl", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def functional(length):
    """Fixed factors in [-1, 1), the same in Rust: the finaliser of MurmurHash3 over the index."""
    h = np.arange(1, length + 1, dtype=np.uint64) & 0xFFFFFFFF
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        h = ((h ^ (h >> np.uint64(shift))) * np.uint64(factor)) & np.uint64(0xFFFFFFFF)
    return torch.from_numpy((h >> np.uint64(8)).astype(np.float64) / 2**23 - 1)


def rotation_of(q):
    """Rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def camera(size, full, shift):
    """Intrinsics [fx, fy, cx, cy, width, height] in our convention (first pixel's centre is 0)."""
    scale = np.array(size) / np.array(full)
    focal = np.array([0.9, 0.95]) * full[0] * scale
    border = (np.array(full) / 2 + shift) * scale  # of the principal point, from the image's border
    return np.float32([*focal, *(border - 0.5), *size]).astype(np.float64)


def make(spec):
    """Seeded parameters, exact in f32, and the pose [qw qx qy qz tx ty tz] of camera_from_world."""
    rng = np.random.default_rng(spec["seed"])
    n, (width, height) = spec["count"], spec["picture"]
    z = rng.uniform(0.8, 4.0, n)
    reach = 0.25 if n == 1 else (0.45 if spec["shift"] else 0.75)
    side = np.array([1, height / width]) / 0.9 * reach
    means = np.concatenate([rng.uniform(-1, 1, (n, 2)) * side * z[:, None], z[:, None]], axis=1)
    if n > 100:
        means[:3, 2] = [-1.0, 0.05, 0.0995]  # behind the camera and nearer than the near plane
    pose = np.array([1.0, 0.03, -0.02, 0.05, 0.02, -0.03, 0.05])
    pose[:4] /= np.linalg.norm(pose[:4])
    pose = np.float32(pose).astype(np.float64)
    rows = {"means": (means - pose[4:]) @ rotation_of(pose[:4])}
    metres = np.maximum(z, 0.8)[:, None] / (0.9 * width)
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
    """camera_from_world = Exp(tau) T with tau = [rho, theta], a twist."""
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = rotation_of(pose[:4]), pose[4:]
    zero = torch.zeros((), dtype=tau.dtype)
    (a, b, c), (x, y, z) = tau[:3], tau[3:]
    rows = [[zero, -z, y, a], [z, zero, -x, b], [-y, x, zero, c], [zero] * 4]
    twist = torch.stack([torch.stack(row) for row in rows])
    return torch.linalg.matrix_exp(twist) @ torch.from_numpy(start)


def project(gsplat, rows, head, cam, view):
    """gsplat's projection with our dilation and planes; its pixel centres lie at one half."""
    fx, fy, cx, cy, width, height = cam
    k = torch.tensor([[[fx, 0, cx + 0.5], [0, fy, cy + 0.5], [0, 0, 1]]], dtype=torch.float64)
    covariance, _ = gsplat._quat_scale_to_covar_preci(
        rows[f"{head}.rotations"], torch.exp(rows[f"{head}.log_scales"]), compute_preci=False
    )
    radii, means, depths, conics, _ = gsplat._fully_fused_projection(
        rows["means"], covariance, view[None], k, int(width), int(height), DILATION, NEAR, FAR
    )
    planes = (depths[0] > NEAR) & (depths[0] < FAR)
    return means, depths, conics, torch.sigmoid(rows[f"{head}.opacity_logits"])[None], planes


def pairs(means, depths, conics, opacities, planes, cam):
    """Gaussian and pixel of each blend, front to back per pixel; Gaussians that are too near a
    cut-off; the number of full pixels."""
    width, height = int(cam[4]), int(cam[5])
    order = torch.argsort(depths[0])
    order = order[planes[order]]
    index = torch.arange(width * height)
    pixel = torch.stack([index % width, index // width], dim=1) + 0.5
    d = pixel[:, None] - means[0][order][None]
    c = conics[0][order]
    sigma = 0.5 * (c[:, 0] * d[..., 0] ** 2 + c[:, 2] * d[..., 1] ** 2)
    sigma = sigma + c[:, 1] * d[..., 0] * d[..., 1]
    alpha = opacities[0][order] * torch.exp(-sigma)
    shown = alpha >= MIN_ALPHA
    through = torch.cumprod(torch.where(shown, 1 - alpha, 1.0), dim=1)
    near = (alpha / MIN_ALPHA - 1).abs() < MARGIN
    near |= shown & ((through / MIN_TRANSMITTANCE - 1).abs() < MARGIN)
    assert float(opacities.max()) < 0.985, "the clamps of alpha differ"
    keep = shown & (through >= MIN_TRANSMITTANCE)
    rays, places = keep.nonzero(as_tuple=True)
    return order[places], rays, order[near.any(0)], int((shown & ~keep).any(1).sum())


def settle(gsplat, rows, spec, pose, rng):
    """Redraws the opacity of Gaussians that are so near a cut-off that rounding decides."""
    view = view_matrix(pose, torch.zeros(6, dtype=torch.float64))
    for head, size in (("color", spec["picture"]), ("language", spec["codes"])):
        cam = camera(size, spec["picture"], spec["shift"])
        while True:
            near = pairs(*project(gsplat, rows, head, cam, view), cam)[2]
            if len(near) == 0:
                break
            fresh = np.float32(rng.uniform(*spec["logits"], len(near))).astype(np.float64)
            rows[f"{head}.opacity_logits"][near] = torch.from_numpy(fresh)


def render(gsplat, rows, head, cam, view):
    """All channels of a head (depth last for color) and alpha."""
    means, depths, conics, opacities, planes = project(gsplat, rows, head, cam, view)
    with torch.no_grad():
        ids, rays, _, full = pairs(means, depths, conics, opacities, planes, cam)
    features = rows[f"{head}.features"][None]
    if head == "color":
        features = torch.cat([features, depths[..., None]], dim=-1)
    width, height = int(cam[4]), int(cam[5])
    image, alpha = gsplat.accumulate(
        means, conics, opacities, features, ids, rays, torch.zeros_like(ids), width, height
    )
    print(f"  {head}: {len(ids)} pairs, {full} of {width * height} pixels full")
    return image[0], alpha[0, ..., 0]


def scene(gsplat, name, spec):
    """Everything of one scene, as arrays by name."""
    rows, pose, rng = make(spec)
    settle(gsplat, rows, spec, pose, rng)
    out = {key: value.clone() for key, value in rows.items()}
    out["pose"] = torch.from_numpy(pose)
    for head, size in (("color", spec["picture"]), ("language", spec["codes"])):
        leaves = {key: value.clone().requires_grad_() for key, value in rows.items()}
        tau = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        cam = camera(size, spec["picture"], spec["shift"])
        image, alpha = render(gsplat, leaves, head, cam, view_matrix(pose, tau))
        loss = (image.flatten() * functional(image.numel())).sum()
        loss.backward()
        out[f"{head}.camera"] = torch.from_numpy(cam)
        out[f"{head}.image"], out[f"{head}.alpha"] = image.detach(), alpha.detach()
        out[f"{head}.d_pose"] = tau.grad
        for key in PARAMETERS:
            if key == "means" or key.startswith(head):
                kind = key.split(".")[-1]
                out[f"{head}.d_{kind}"] = leaves[key].grad
    arrays = {key: value.numpy().astype(np.float32) for key, value in out.items()}
    return {key: np.ascontiguousarray(value) for key, value in arrays.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the files")
    arguments = parser.parse_args()
    gsplat = load_gsplat()
    version = importlib.metadata.version("gsplat")
    made_by = {"made_by": f"gsplat {version}, torch {torch.__version__}"}
    for name, spec in SCENES.items():
        print(name)
        file = arguments.out / f"{name}.safetensors"
        save_file(scene(gsplat, name, spec), file, made_by)
        file.chmod(0o644)


if __name__ == "__main__":
    main()
