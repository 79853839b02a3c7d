"""Maps what a RealSense sees and asks where something is: `realsense.py WORDS FRAMES [SERVER]`.

Needs `pip install pyrealsense2`. Depth is sent as the camera takes it; the server registers it.
"""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyrealsense2 as rs

import lexsplat


def camera(lens: Any) -> lexsplat.Camera:
    """A camera of librealsense. Its models, but for fisheyes, are close to OpenCV's."""
    size = (lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)
    if lens.model == rs.distortion.kannala_brandt4:
        return lexsplat.Camera(*size, "fisheye", coefficients=lens.coeffs[:4])
    return lexsplat.Camera(*size, "plumb_bob", coefficients=lens.coeffs)


def frames(pipeline: Any, count: int) -> Iterator[lexsplat.Frame]:
    """What the camera sees."""
    for _ in range(count):
        taken = pipeline.wait_for_frames()
        color, depth = taken.get_color_frame(), taken.get_depth_frame()
        yield lexsplat.Frame(
            np.asanyarray(color.get_data()),
            np.asanyarray(depth.get_data()),
            time=color.get_timestamp() / 1000,
            depth_time=depth.get_timestamp() / 1000,
        )


def main() -> None:
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    words, count, *server = sys.argv[1:]
    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    config.enable_stream(rs.stream.color, 640, 480, rs.format.rgb8, 30)
    profile = pipeline.start(config)
    try:
        color, depth = (
            profile.get_stream(kind).as_video_stream_profile()
            for kind in (rs.stream.color, rs.stream.depth)
        )
        moved = depth.get_extrinsics_to(color)
        color_from_depth = np.eye(4)
        color_from_depth[:3, :3] = np.reshape(moved.rotation, (3, 3), order="F")
        color_from_depth[:3, 3] = moved.translation
        room = lexsplat.Client(*server).map("realsense")
        summary = room.stream(
            frames(pipeline, int(count)),
            camera(color.get_intrinsics()),
            depth_camera=lexsplat.DepthCamera(camera(depth.get_intrinsics()), color_from_depth),
            depth_unit=profile.get_device().first_depth_sensor().get_depth_scale(),
        )
    finally:
        pipeline.stop()
    print(summary)
    print(room.query(words, wait_seconds=120).objects[:3])


if __name__ == "__main__":
    main()
