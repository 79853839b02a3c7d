"""Maps what an Azure Kinect sees and asks: `azure_kinect.py WORDS FRAMES [SERVER]`.

Needs the Azure Kinect SDK and `pip install pyk4a`. Color is sent as the JPEG that the camera makes,
depth as it is taken; the server registers it.
"""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyk4a
from pyk4a import CalibrationType

import lexsplat


def camera(kinect: Any, which: Any, width: int, height: int) -> lexsplat.Camera:
    """One of the two cameras."""
    return lexsplat.Camera.from_matrix(
        kinect.calibration.get_camera_matrix(which),
        width,
        height,
        "rational_polynomial",
        coefficients=kinect.calibration.get_distortion_coefficients(which),
    )


def frames(kinect: Any, count: int) -> Iterator[lexsplat.Frame]:
    """What the camera sees."""
    for _ in range(count):
        taken = kinect.get_capture()
        yield lexsplat.Frame(
            taken.color.tobytes(),
            taken.depth,
            time=taken.color_timestamp_usec / 1e6,
            depth_time=taken.depth_timestamp_usec / 1e6,
        )


def main() -> None:
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    words, count, *server = sys.argv[1:]
    kinect = pyk4a.PyK4A(
        pyk4a.Config(
            color_resolution=pyk4a.ColorResolution.RES_720P,
            color_format=pyk4a.ImageFormat.COLOR_MJPG,
            depth_mode=pyk4a.DepthMode.NFOV_UNBINNED,
            synchronized_images_only=True,
        )
    )
    kinect.start()
    try:
        color = camera(kinect, CalibrationType.COLOR, 1280, 720)
        depth = camera(kinect, CalibrationType.DEPTH, 640, 576)
        turn, shift = kinect.calibration.get_extrinsic_parameters(
            CalibrationType.DEPTH, CalibrationType.COLOR
        )
        color_from_depth = np.eye(4)
        color_from_depth[:3, :3], color_from_depth[:3, 3] = turn, np.ravel(shift)
        room = lexsplat.Client(*server).map("azure-kinect")
        summary = room.stream(
            frames(kinect, int(count)),
            color,
            depth_camera=lexsplat.DepthCamera(depth, color_from_depth),
        )
    finally:
        kinect.stop()
    print(summary)
    print(room.query(words, wait_seconds=120).objects[:3])


if __name__ == "__main__":
    main()
