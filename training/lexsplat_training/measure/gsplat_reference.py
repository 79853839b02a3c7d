"""gsplat's PyTorch reference as a renderer, without the rest of the package, which needs CUDA.

gsplat's file `cuda/_torch_impl.py` is loaded by itself. Its `accumulate` calls two functions of
nerfacc, which has them for CUDA only; the two below do the same in plain PyTorch. gsplat's CUDA
extension decides which pairs of Gaussian and pixel are blended; here `pairs` does: alpha >= 1/255,
until the transmittance would fall below 1e-4.
"""

import importlib.metadata
import importlib.util
import sys
import types

import torch

MIN_ALPHA = 1 / 255
MIN_TRANSMITTANCE = 1e-4
NEAR, FAR, DILATION = 0.1, 1e6, 0.1  # metres, metres, square pixels
MARGIN = 3e-5  # smallest relative distance of an alpha or transmittance to its cut-off


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


def load():
    """gsplat's module of PyTorch functions."""
    stand_in = types.ModuleType("nerfacc")
    stand_in.render_weight_from_alpha = weight_from_alpha
    stand_in.accumulate_along_rays = along_rays
    sys.modules["nerfacc"] = stand_in
    path = importlib.metadata.distribution("gsplat").locate_file("gsplat/cuda/_torch_impl.py")
    spec = importlib.util.spec_from_file_location("gsplat_torch_impl", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def project(gsplat, rows, head, cam, view):
    """(means, depths, conics, opacities, inside both planes) of a head's Gaussians in the image.

    gsplat's projection with the renderer's dilation and planes. gsplat's pixel centres are at 0.5.
    """
    fx, fy, cx, cy, width, height = cam
    k = torch.tensor([[[fx, 0, cx + 0.5], [0, fy, cy + 0.5], [0, 0, 1]]], dtype=torch.float64)
    covariance, _ = gsplat._quat_scale_to_covar_preci(
        rows[f"{head}.rotations"], torch.exp(rows[f"{head}.log_scales"]), compute_preci=False
    )
    _, means, depths, conics, _ = gsplat._fully_fused_projection(
        rows["means"], covariance, view[None], k, int(width), int(height), DILATION, NEAR, FAR
    )
    planes = (depths[0] > NEAR) & (depths[0] < FAR)
    return means, depths, conics, torch.sigmoid(rows[f"{head}.opacity_logits"])[None], planes


def pairs(projected, cam):
    """(Gaussians, pixels, Gaussians too near a cut-off, number of full pixels).

    The first two list every blend, front to back per pixel; `projected`: from `project`.
    """
    means, depths, conics, opacities, planes = projected
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
    assert float(opacities.max()) < 0.985, "gsplat clamps alpha at another value"
    keep = shown & (through >= MIN_TRANSMITTANCE)
    rays, places = keep.nonzero(as_tuple=True)
    return order[places], rays, order[near.any(0)], int((shown & ~keep).any(1).sum())


def render(gsplat, rows, head, cam, view):
    """(image [height, width, channels], alpha [height, width]); color has depth as last channel."""
    projected = project(gsplat, rows, head, cam, view)
    means, depths, conics, opacities, _ = projected
    with torch.no_grad():
        ids, rays, _, full = pairs(projected, cam)
    features = rows[f"{head}.features"][None]
    if head == "color":
        features = torch.cat([features, depths[..., None]], dim=-1)
    width, height = int(cam[4]), int(cam[5])
    image, alpha = gsplat.accumulate(
        means, conics, opacities, features, ids, rays, torch.zeros_like(ids), width, height
    )
    print(f"  {head}: {len(ids)} pairs, {full} of {width * height} pixels full")
    return image[0], alpha[0, ..., 0]
