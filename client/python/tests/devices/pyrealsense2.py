"""A simulated RealSense, with the interface of pyrealsense2 2.5x as far as the example uses it."""

from __future__ import annotations

from enum import Enum
from types import SimpleNamespace

import numpy as np
from recording import Recording

# What the device calls a unit of depth, metres.
_UNIT = 0.00025

distortion = Enum(
    "distortion",
    "none modified_brown_conrady inverse_brown_conrady ftheta brown_conrady kannala_brandt4",
)
stream = Enum("stream", "depth color infrared")
format = Enum("format", "z16 rgb8 bgr8")


class config:  # noqa: N801 (the library's name)
    def __init__(self) -> None:
        self.streams: dict[stream, tuple] = {}

    def enable_stream(self, kind, width, height, pixels, rate):
        self.streams[kind] = (width, height, pixels, rate)


class _Profile:
    def __init__(self, recording, kind, model):
        self._recording, self._kind, self._model = recording, kind, model

    def as_video_stream_profile(self):
        return self

    def get_intrinsics(self):
        lens = self._recording.lenses[self._kind.name]
        return SimpleNamespace(
            width=lens.width,
            height=lens.height,
            fx=lens.fx,
            fy=lens.fy,
            ppx=lens.cx,
            ppy=lens.cy,
            model=self._model,
            coeffs=[0.0] * 5,
        )

    def get_extrinsics_to(self, other):
        assert (self._kind, other._kind) == (stream.depth, stream.color)
        pose = self._recording.color_from_depth
        # Column by column.
        return SimpleNamespace(
            rotation=pose[:3, :3].ravel(order="F").tolist(), translation=pose[:3, 3].tolist()
        )


class _Frame:
    def __init__(self, data, milliseconds):
        self._data, self._milliseconds = data, milliseconds

    def get_data(self):
        return memoryview(self._data)

    def get_timestamp(self):
        return self._milliseconds


class pipeline:  # noqa: N801 (the library's name)
    def __init__(self) -> None:
        self._recording, self._number, self._is_running = Recording(), 0, False

    def start(self, chosen):
        assert chosen.streams[stream.depth][2] is format.z16
        assert chosen.streams[stream.color][2] is format.rgb8
        self._is_running = True
        models = {
            stream.color: distortion.inverse_brown_conrady,
            stream.depth: distortion.brown_conrady,
        }
        sensor = SimpleNamespace(get_depth_scale=lambda: _UNIT)
        return SimpleNamespace(
            get_stream=lambda kind: _Profile(self._recording, kind, models[kind]),
            get_device=lambda: SimpleNamespace(first_depth_sensor=lambda: sensor),
        )

    def wait_for_frames(self):
        assert self._is_running
        at, self._number = self._number, self._number + 1
        depth = np.round(self._recording.depth(at) / _UNIT).astype(np.uint16)
        color = self._recording.color(at)
        # The two cameras of the device take turns.
        milliseconds = 1_764_000_000_000.0 + at * 1000 / 30
        return SimpleNamespace(
            get_color_frame=lambda: _Frame(color, milliseconds),
            get_depth_frame=lambda: _Frame(depth, milliseconds),
        )

    def stop(self):
        assert self._is_running
        self._is_running = False
