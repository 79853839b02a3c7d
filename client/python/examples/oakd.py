"""Maps what an OAK-D sees and asks where something is: `oakd.py WORDS FRAMES [SERVER]`.

Needs `pip install depthai` (version 3). Depth is sent as the camera computes it; the server
registers it.
"""

import sys
from collections.abc import Iterator
from typing import Any

import depthai as dai
import numpy as np

import lexsplat


def camera(image: Any) -> lexsplat.Camera:
    """The camera that an image says it is of, after all that the device did to it."""
    how = image.getTransformation()
    width, height = how.getSize()
    coefficients = how.getDistortionCoefficients()
    is_fisheye = how.getDistortionModel() == dai.CameraModel.Fisheye
    return lexsplat.Camera.from_matrix(
        how.getIntrinsicMatrix(),
        width,
        height,
        "fisheye" if is_fisheye else "rational_polynomial",
        coefficients=coefficients[:4] if is_fisheye else coefficients,
    )


def frames(first: Any, queue: Any, count: int) -> Iterator[lexsplat.Frame]:
    """What the camera sees, beginning with a pair that was taken already."""
    for number in range(count):
        pair = queue.get() if number else first
        yield lexsplat.Frame(
            pair["color"].getFrame(),
            pair["depth"].getFrame(),
            time=pair["color"].getTimestamp().total_seconds(),
            depth_time=pair["depth"].getTimestamp().total_seconds(),
        )


def main() -> None:
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    words, count, *server = sys.argv[1:]
    with dai.Pipeline() as pipeline:
        lens = pipeline.create(dai.node.Camera).build(dai.CameraBoardSocket.CAM_A)
        stereo = pipeline.create(dai.node.StereoDepth).build(True, size=(640, 400))
        pairs = pipeline.create(dai.node.Sync)
        lens.requestOutput((640, 400), dai.ImgFrame.Type.RGB888i).link(pairs.inputs["color"])
        stereo.depth.link(pairs.inputs["depth"])
        queue = pairs.out.createOutputQueue()
        pipeline.start()
        first = queue.get()
        color, depth = first["color"], first["depth"]
        color_from_depth = depth.getTransformation().getExtrinsicsTransformationMatrixTo(
            color.getTransformation(), False, dai.LengthUnit.METER
        )
        room = lexsplat.Client(*server).map("oakd")
        summary = room.stream(
            frames(first, queue, int(count)),
            camera(color),
            depth_camera=lexsplat.DepthCamera(camera(depth), np.array(color_from_depth)),
        )
    print(summary)
    print(room.query(words, wait_seconds=120).objects[:3])


if __name__ == "__main__":
    main()
