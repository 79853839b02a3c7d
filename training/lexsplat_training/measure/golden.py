"""Write the renderer's reference pictures and gradients, computed by gsplat's PyTorch reference.

One safetensors file per scene; gpu/tests/golden/README.md explains their contents. Computed in f64
from inputs that are exact in f32, stored in f32.
"""

import importlib.metadata
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save_file

from ..command_line import parser
from . import gsplat_reference
from .golden_scenes import SCENES, camera, make, view_matrix

EXAMPLE = "--out ../gpu/tests/golden"
PARAMETERS = ["means"] + [
    f"{head}.{kind}"
    for head in ("color", "language")
    for kind in ("rotations", "log_scales", "opacity_logits", "features")
]


def functional(length):
    """Fixed factors in [-1, 1): the finaliser of MurmurHash3 over the index, as in golden.rs."""
    h = np.arange(1, length + 1, dtype=np.uint64) & 0xFFFFFFFF
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        h = ((h ^ (h >> np.uint64(shift))) * np.uint64(factor)) & np.uint64(0xFFFFFFFF)
    return torch.from_numpy((h >> np.uint64(8)).astype(np.float64) / 2**23 - 1)


def settle(gsplat, rows, spec, pose, rng):
    """Redraws opacities of Gaussians that are so near a cut-off that rounding would decide."""
    view = view_matrix(pose, torch.zeros(6, dtype=torch.float64))
    for head, size in (("color", spec["picture"]), ("language", spec["codes"])):
        cam = camera(size, spec["picture"], spec["shift"])
        while True:
            projected = gsplat_reference.project(gsplat, rows, head, cam, view)
            near = gsplat_reference.pairs(projected, cam)[2]
            if len(near) == 0:
                break
            fresh = np.float32(rng.uniform(*spec["logits"], len(near))).astype(np.float64)
            rows[f"{head}.opacity_logits"][near] = torch.from_numpy(fresh)


def scene(gsplat, spec):
    """Parameters, pictures and gradients of one scene: arrays by name."""
    rows, pose, rng = make(spec)
    settle(gsplat, rows, spec, pose, rng)
    out = {key: value.clone() for key, value in rows.items()}
    out["pose"] = torch.from_numpy(pose)
    for head, size in (("color", spec["picture"]), ("language", spec["codes"])):
        leaves = {key: value.clone().requires_grad_() for key, value in rows.items()}
        tau = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        cam = camera(size, spec["picture"], spec["shift"])
        view = view_matrix(pose, tau)
        image, alpha = gsplat_reference.render(gsplat, leaves, head, cam, view)
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


def arguments_parser():
    arguments = parser("golden", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    gsplat = gsplat_reference.load()
    version = importlib.metadata.version("gsplat")
    made_by = {"made_by": f"gsplat {version}, torch {torch.__version__}"}
    for name, spec in SCENES.items():
        print(name)
        file = args.out / f"{name}.safetensors"
        save_file(scene(gsplat, spec), file, made_by)
        file.chmod(0o644)
