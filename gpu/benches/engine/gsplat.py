"""Times gsplat's forward and backward pass on the scene that the bench's section `exchange` wrote.

python gsplat.py FOLDER; needs CUDA, torch, numpy and gsplat. Prints milliseconds on the device, the
best of several runs, and the PSNR between both pictures: below 40 dB the two did not draw the same.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from gsplat import rasterization

RUNS = 20
NEAR, DILATION = 0.1, 0.1  # metres, square pixels: the engine's


def main(folder: Path) -> None:
    def read(name: str, *shape: int) -> torch.Tensor:
        values = np.fromfile(folder / f"{name}.f32", dtype="<f4").reshape(shape)
        return torch.from_numpy(values.copy()).cuda()

    size = np.fromfile(folder / "camera.f32", dtype="<f4")
    width, height = int(size[0]), int(size[1])
    fx, fy, cx, cy = (float(value) for value in size[2:])
    # gsplat's pixel centres are at 0.5, the engine's at 0.
    intrinsics = torch.tensor([[[fx, 0, cx + 0.5], [0, fy, cy + 0.5], [0, 0, 1]]], device="cuda")
    parameters = [
        read("means", -1, 3),
        read("rotations", -1, 4),
        read("log_scales", -1, 3),
        read("opacity_logits", -1),
        read("colors", -1, 3),
    ]
    for parameter in parameters:
        parameter.requires_grad_(True)
    pose = torch.eye(4, device="cuda")[None]

    def draw() -> torch.Tensor:
        means, rotations, log_scales, logits, colors = parameters
        return rasterization(
            means,
            rotations,
            log_scales.exp(),
            logits.sigmoid(),
            colors,
            pose,
            intrinsics,
            width,
            height,
            near_plane=NEAR,
            eps2d=DILATION,
            render_mode="RGB+D",
        )[0][0]

    forward, backward = float("inf"), float("inf")
    for _ in range(RUNS):
        marks = [torch.cuda.Event(enable_timing=True) for _ in range(3)]
        marks[0].record()
        image = draw()
        marks[1].record()
        image.mean().backward()
        marks[2].record()
        torch.cuda.synchronize()
        forward = min(forward, marks[0].elapsed_time(marks[1]))
        backward = min(backward, marks[1].elapsed_time(marks[2]))
    with torch.no_grad():
        error = (draw()[..., :3] - read("rgb", height, width, 3)).square().mean()
    print(f"gsplat, {len(parameters[0])} Gaussians at {width} x {height}; ms")
    print(f"{'forward, device':>28} {forward:>9.2f}")
    print(f"{'backward, device':>28} {backward:>9.2f}")
    print(f"{'PSNR between both, dB':>28} {float(-10 * error.log10()):>9.1f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
