"""A simulated Azure Kinect, with the interface of pyk4a 1.5 as far as the example uses it.

Both lenses bend, as the real ones do.
"""

from __future__ import annotations

import io
from enum import Enum, IntEnum
from types import SimpleNamespace

import numpy as np
from PIL import Image
from recording import Recording, millimetres, seen

ColorResolution = Enum("ColorResolution", "OFF RES_720P RES_1080P")
ImageFormat = Enum("ImageFormat", "COLOR_MJPG COLOR_BGRA32")
DepthMode = Enum("DepthMode", "OFF NFOV_UNBINNED WFOV_UNBINNED")

# As of a real device, k1 k2 p1 p2 k3 k4 k5 k6, but weaker: their field of view is wider here.
_COLOR_BENDS = (0.18, -0.72, 0.0008, -0.0001, 0.41, 0.15, -0.68, 0.39)
_DEPTH_BENDS = (0.78, 0.58, 0.00008, -0.00005, 0.03, 0.86, 0.84, 0.17)


class CalibrationType(IntEnum):
    DEPTH = 0
    COLOR = 1


class Config(SimpleNamespace):
    pass


class _Calibration:
    def __init__(self, recording, lenses):
        self._recording, self._lenses = recording, lenses

    def get_camera_matrix(self, which):
        return self._lenses[which].matrix

    def get_distortion_coefficients(self, which):
        return np.array(self._lenses[which].coefficients)

    def get_extrinsic_parameters(self, source, target):
        assert (source, target) == (CalibrationType.DEPTH, CalibrationType.COLOR)
        pose = self._recording.color_from_depth
        return pose[:3, :3], pose[:3, 3].reshape(1, 3)


class PyK4A:
    def __init__(self, config):
        assert config.color_resolution is ColorResolution.RES_720P
        assert config.color_format is ImageFormat.COLOR_MJPG
        assert config.depth_mode is DepthMode.NFOV_UNBINNED and config.synchronized_images_only
        self._recording, self._number, self._is_running = Recording(), 0, False
        own = self._recording.lenses
        self._lenses = {
            CalibrationType.COLOR: own["color"].scaled(1280, 720, _COLOR_BENDS),
            CalibrationType.DEPTH: own["depth"].scaled(640, 576, _DEPTH_BENDS),
        }
        self.calibration = _Calibration(self._recording, self._lenses)

    def start(self):
        self._is_running = True

    def stop(self):
        assert self._is_running
        self._is_running = False

    def get_capture(self):
        assert self._is_running
        at, self._number = self._number, self._number + 1
        own, recording = self._recording.lenses, self._recording
        color = seen(recording.color(at), own["color"], self._lenses[CalibrationType.COLOR])
        depth = seen(recording.depth(at), own["depth"], self._lenses[CalibrationType.DEPTH])
        jpeg = io.BytesIO()
        Image.fromarray(color).save(jpeg, "JPEG", quality=92)
        return SimpleNamespace(
            color=np.frombuffer(jpeg.getvalue(), np.uint8),
            depth=millimetres(depth),
            color_timestamp_usec=1_000_000 + at * 33_333,
            depth_timestamp_usec=1_000_160 + at * 33_333,
        )
