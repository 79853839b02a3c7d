"""Frames: a color image with the depth of the same moment."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from lexsplat._camera import Camera
from lexsplat._errors import FrameError
from lexsplat._geometry import numbers, rigid, wire_pose, wire_vector
from lexsplat.v1 import lexsplat_pb2 as v1

Image: TypeAlias = npt.NDArray[Any]

_JPEG = b"\xff\xd8\xff"
_PNG = b"\x89PNG\r\n\x1a\n"
_NANOS = 1_000_000_000


@dataclass(eq=False)
class Frame:
    """One RGB-D frame, with color and depth as the camera gives them.

    Attributes:
        color: Array of shape (height, width, 3), uint8, red green blue; or the bytes of a JPEG or
            PNG. OpenCV's images are blue green red: give `image[..., ::-1]`.
        depth: Array of shape (height, width): uint16 in units of the stream's `depth_unit`, or
            float in metres; or the bytes of a grey 16-bit PNG. 0, NaN and 65535 are no measurement.
        time: When color was taken, seconds since any moment, increasing. None: one interval after
            the frame before.
        pose: 4x4 world_from_camera, metres; camera axes x right, y down, z forward. Needed with
            `poses="given"`; with `poses="estimate"` a hint.
        covariance: 6x6 covariance of `pose` (metres, radians; a left perturbation). None: exact.
        labels: Array of shape (height, width), uint8 or uint16, or the bytes of a grey PNG: label n
            stands for the n-th of the stream's `label_texts`, 0 for nothing.
        held_out: Track the frame, but never make a keyframe of it, to evaluate the map with it.
        camera: The color camera of this frame, where autofocus changes it. Its distortion is the
            stream's.
        depth_time: When depth was taken, seconds. None: together with color.
        up: The direction up in the camera's coordinates, of any length: what an accelerometer at
            rest measures.
        sequence: Number of the frame, increasing. With numbers, frames that the map has already are
            skipped, so the same program can be run again. None: the next after the map's newest.
    """

    color: Image | bytes
    depth: Image | bytes
    _: KW_ONLY
    time: float | None = None
    pose: npt.ArrayLike | None = None
    covariance: npt.ArrayLike | None = None
    labels: Image | bytes | None = None
    held_out: bool = False
    camera: Camera | None = None
    depth_time: float | None = None
    up: npt.ArrayLike | None = None
    sequence: int | None = None


def message(frame: Frame, color_shape: tuple[int, int], depth_shape: tuple[int, int]) -> v1.Frame:
    """A frame as a message, for cameras of these sizes.

    Raises:
        FrameError: A type, shape or value is wrong.
    """
    if not isinstance(frame, Frame):
        raise FrameError(f"frames: expected lexsplat.Frame, found {type(frame).__name__}")
    wire = v1.Frame(held_out=bool(frame.held_out))
    wire.color_format, wire.color = _color(frame.color, color_shape)
    wire.depth_format, wire.depth = _depth(frame.depth, depth_shape)
    if frame.labels is not None:
        wire.label_format, wire.labels = _labels(frame.labels, color_shape)
    if frame.camera is not None:
        if frame.camera.shape != color_shape:
            raise _wrong_shape("camera", color_shape, frame.camera.shape)
        wire.intrinsics.CopyFrom(frame.camera._wire())
    wire.timestamp_nanos = _nanos(frame.time, "time")
    wire.depth_timestamp_nanos = _nanos(frame.depth_time, "depth_time")
    try:
        if frame.pose is not None:
            wire.world_from_camera.CopyFrom(wire_pose(rigid(frame.pose, "pose")))
        if frame.covariance is not None:
            covariance = numbers(frame.covariance, (6, 6), "covariance")
            wire.pose_covariance.extend(covariance.ravel().tolist())
        if frame.up is not None:
            wire.up.CopyFrom(wire_vector(numbers(frame.up, (3,), "up")))
    except ValueError as error:
        raise FrameError(str(error)) from None
    return wire


def _nanos(seconds: float | None, name: str) -> int:
    if seconds is None:
        return 0
    if not math.isfinite(seconds) or seconds < 0:
        raise FrameError(f"{name}: expected seconds, 0 or more, found {seconds!r}")
    if seconds * _NANOS >= 1 << 64:
        raise FrameError(f"{name}: expected seconds, found {seconds!r}: are they nanoseconds?")
    # Whole seconds apart, so that a time since 1970 loses nothing more.
    whole = int(seconds)
    return whole * _NANOS + round((seconds - whole) * _NANOS)


def _color(color: Image | bytes, shape: tuple[int, int]) -> tuple[v1.ColorFormat, bytes]:
    if isinstance(color, bytes | bytearray | memoryview):
        data = bytes(color)
        if data.startswith(_JPEG):
            return v1.COLOR_FORMAT_JPEG, data
        if data.startswith(_PNG):
            return v1.COLOR_FORMAT_PNG, data
        raise FrameError(
            "color: expected the bytes of a JPEG or PNG, or an array of shape (height, width, 3)"
        )
    image = _array(color, "color")
    if image.ndim == 3 and image.shape[2] == 4:
        raise FrameError("color: found four channels; leave alpha out: image[..., :3]")
    if image.ndim == 2:
        raise FrameError("color: found a grey image; repeat it: numpy.dstack([image] * 3)")
    if image.shape != (*shape, 3):
        raise _wrong_shape("color", (*shape, 3), image.shape)
    if image.dtype != np.uint8:
        raise FrameError(f"color: expected uint8 from 0 to 255, found {image.dtype}")
    return v1.COLOR_FORMAT_RGB8, np.ascontiguousarray(image).tobytes()


def _depth(depth: Image | bytes, shape: tuple[int, int]) -> tuple[v1.DepthFormat, bytes]:
    if isinstance(depth, bytes | bytearray | memoryview):
        data = bytes(depth)
        if data.startswith(_PNG):
            return v1.DEPTH_FORMAT_PNG16, data
        raise FrameError(
            "depth: expected the bytes of a 16-bit PNG, or an array of shape (height, width)"
        )
    image = _array(depth, "depth")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    if image.shape != shape:
        hint = "; give depth_camera= if depth has a camera of its own" if image.ndim == 2 else ""
        raise _wrong_shape("depth", shape, image.shape, hint)
    if image.dtype.kind == "u" and image.dtype.itemsize == 2:
        return v1.DEPTH_FORMAT_U16, image.astype("<u2", order="C", copy=False).tobytes()
    if image.dtype.kind == "f":
        return v1.DEPTH_FORMAT_F32_METRES, image.astype("<f4", order="C", copy=False).tobytes()
    raise FrameError(f"depth: expected uint16, or float in metres, found {image.dtype}")


def _labels(labels: Image | bytes, shape: tuple[int, int]) -> tuple[v1.LabelFormat, bytes]:
    if isinstance(labels, bytes | bytearray | memoryview):
        data = bytes(labels)
        if data.startswith(_PNG):
            return v1.LABEL_FORMAT_PNG, data
        raise FrameError("labels: expected the bytes of a PNG, or an array")
    image = _array(labels, "labels")
    if image.shape != shape:
        raise _wrong_shape("labels", shape, image.shape)
    if image.dtype.kind != "u" or image.dtype.itemsize > 2:
        raise FrameError(f"labels: expected uint8 or uint16, found {image.dtype}")
    return v1.LABEL_FORMAT_U16, image.astype("<u2", order="C", copy=False).tobytes()


def _array(image: Image, name: str) -> Image:
    if not hasattr(image, "__array__") and not hasattr(image, "__array_interface__"):
        raise FrameError(f"{name}: expected an array or bytes, found {type(image).__name__}")
    return np.asarray(image)


def _wrong_shape(
    name: str, expected: tuple[int, ...], found: tuple[int, ...], hint: str = ""
) -> FrameError:
    return FrameError(f"{name}: expected shape {expected} as the camera says, found {found}{hint}")
