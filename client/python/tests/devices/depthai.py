"""A simulated OAK-D, with the interface of depthai 3 as far as the example uses it."""

from __future__ import annotations

from datetime import timedelta
from enum import Enum
from types import SimpleNamespace

from recording import Recording, millimetres

CameraModel = Enum("CameraModel", "Perspective Fisheye")
LengthUnit = Enum("LengthUnit", "METER CENTIMETER")
CameraBoardSocket = Enum("CameraBoardSocket", "CAM_A CAM_B CAM_C")


class _Transformation:
    def __init__(self, recording, kind):
        self._recording, self.kind = recording, kind
        self._lens = recording.lenses[kind]

    def getSize(self):  # noqa: N802 (the library's names, here and below)
        return self._lens.width, self._lens.height

    def getIntrinsicMatrix(self):  # noqa: N802
        return self._lens.matrix.tolist()

    def getDistortionModel(self):  # noqa: N802
        return CameraModel.Perspective

    def getDistortionCoefficients(self):  # noqa: N802
        # Fourteen for color, of which thin prisms and tilts are 0; none for rectified depth.
        return [0.0] * 14 if self.kind == "color" else []

    def getExtrinsicsTransformationMatrixTo(self, to, useSpecTranslation, sourceUnit):  # noqa: N802, N803
        assert (self.kind, to.kind) == ("depth", "color") and not useSpecTranslation
        pose = self._recording.color_from_depth.copy()
        pose[:3, 3] *= {LengthUnit.METER: 1, LengthUnit.CENTIMETER: 100}[sourceUnit]
        return pose.tolist()


class ImgFrame:
    Type = Enum("Type", "RGB888i BGR888i")

    def __init__(self, recording, kind, image, seconds):
        self._transformation = _Transformation(recording, kind)
        self._image, self._seconds = image, seconds

    def getFrame(self):  # noqa: N802
        return self._image

    def getTimestamp(self):  # noqa: N802
        return timedelta(seconds=self._seconds)

    def getTransformation(self):  # noqa: N802
        return self._transformation


class _Output:
    def __init__(self, name):
        self.name = name

    def link(self, target):
        target.append(self.name)


class _Camera:
    def build(self, socket):
        assert socket is CameraBoardSocket.CAM_A
        return self

    def requestOutput(self, size, kind):  # noqa: N802
        assert len(size) == 2 and kind is ImgFrame.Type.RGB888i
        return _Output("color")


class _StereoDepth:
    depth = _Output("depth")

    def build(self, autoCreateCameras, size):  # noqa: N803
        assert autoCreateCameras and len(size) == 2
        return self


class _Sync:
    def __init__(self):
        self.inputs: dict[str, list[str]] = {"color": [], "depth": []}
        self.out = self

    def createOutputQueue(self):  # noqa: N802
        return self

    def get(self):
        assert self.inputs == {"color": ["color"], "depth": ["depth"]} and Pipeline.is_running
        at, Pipeline.number = Pipeline.number, Pipeline.number + 1
        recording, seconds = Pipeline.recording, 5 + at / 30
        color, depth = recording.color(at), millimetres(recording.depth(at))
        return {
            "color": ImgFrame(recording, "color", color, seconds),
            "depth": ImgFrame(recording, "depth", depth, seconds + 0.002),
        }


node = SimpleNamespace(Camera=_Camera, StereoDepth=_StereoDepth, Sync=_Sync)


class Pipeline:
    recording = Recording()
    number = 0
    is_running = False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        Pipeline.is_running = False

    def create(self, kind):
        return kind()

    def start(self):
        Pipeline.is_running = True
