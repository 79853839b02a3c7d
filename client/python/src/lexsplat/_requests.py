"""What users ask for, as messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, TypedDict

import numpy.typing as npt

from lexsplat._camera import Camera, DepthCamera, SameLens
from lexsplat._errors import CameraError, RequestError
from lexsplat._geometry import numbers, rigid, wire_pose, wire_vector
from lexsplat.v1 import lexsplat_pb2 as v1

Poses: TypeAlias = Literal["given", "estimate"]
_POSES = {"given": v1.POSE_SOURCE_GIVEN, "estimate": v1.POSE_SOURCE_ESTIMATED}

ExportFormat: TypeAlias = Literal[
    "ply", "splat", "spz", "glb", "mesh", "points", "language", "tum", "trajectory"
]
UpAxis: TypeAlias = Literal["x", "y", "z", "-x", "-y", "-z", "map"]
EXPORTS: dict[str, str] = {
    "ply": "splats.ply",
    "splat": "splats.splat",
    "spz": "splats.spz",
    "glb": "splats.glb",
    "mesh": "mesh.ply",
    "points": "points.ply",
    "language": "language.npz",
    "tum": "trajectory.tum",
    "trajectory": "trajectory.json",
}


class StreamOptions(TypedDict, total=False):
    """How a stream's frames are to be understood.

    Attributes:
        poses: "estimate" (the default): the server finds out where frames were taken; "given": each
            frame says so.
        depth_camera: The camera of depth, if depth is not registered to color.
        depth_unit: Metres per unit of uint16 depth; 0.001 by default.
        depth_range: Nearest and farthest depth that counts as a measurement, metres.
        no_depth: Values of uint16 depth that mean no measurement, beside 0; 65535 by default.
        up: The direction up in the world of given poses: (0, 0, 1) for those of ROS.
        label_texts: Text of label 1, 2, … in the frames' labels.
    """

    poses: Poses
    depth_camera: DepthCamera | SameLens | None
    depth_unit: float
    depth_range: tuple[float, float] | None
    no_depth: Sequence[int]
    up: npt.ArrayLike | None
    label_texts: Sequence[str]


def opening(name: str, camera: Camera, options: StreamOptions) -> v1.OpenMap:
    """The message that opens a stream.

    Raises:
        CameraError: An option is impossible.
        TypeError: An option is unknown.
    """
    unknown = options.keys() - StreamOptions.__annotations__.keys()
    if unknown:
        known = ", ".join(StreamOptions.__annotations__)
        raise TypeError(f"no such option: {', '.join(sorted(unknown))}; there are {known}")
    if not isinstance(camera, Camera):
        raise CameraError(f"camera: expected lexsplat.Camera, found {type(camera).__name__}")
    poses = options.get("poses", "estimate")
    if poses not in _POSES:
        raise CameraError(f'poses: expected "given" or "estimate", found {poses!r}')
    near, far = options.get("depth_range") or (0.0, 0.0)
    depth, up = options.get("depth_camera"), options.get("up")
    return v1.OpenMap(
        map=name,
        intrinsics=camera._wire(),
        distortion=camera._wire_distortion(),
        depth_camera=None if depth is None else depth._wire(),
        depth_unit_metres=options.get("depth_unit", 0.001),
        min_depth_metres=near,
        max_depth_metres=far,
        no_depth=[int(value) for value in options.get("no_depth", ())],
        up=None if up is None else wire_vector(_numbers(up, "up")),
        pose_source=_POSES[poses],
        label_texts=options.get("label_texts", ()),
    )


def question(
    name: str,
    *,
    text: str = "",
    texts: Sequence[str] = (),
    negatives: Sequence[str] = (),
    frame: int | None = None,
    camera: Camera | None = None,
    pose: npt.ArrayLike | None = None,
    threshold: float | None = None,
    smoothing: int | None = None,
    max_objects: int | None = None,
    near: npt.ArrayLike | None = None,
    within: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    wait_seconds: float | None = None,
    min_sequence: int | None = None,
) -> v1.QueryRequest:
    """A question.

    Raises:
        RequestError: Two arguments contradict each other.
    """
    if (camera is None) != (pose is None) or (frame is not None and camera is not None):
        raise RequestError("a view is frame=, or camera= with pose=")
    request = v1.QueryRequest(
        map=name,
        text=text,
        texts=texts,
        negatives=negatives,
        threshold=threshold,
        smoothing_pixels=smoothing,
        max_objects=max_objects,
        **waiting(wait_seconds, min_sequence),
    )
    if frame is not None:
        request.view.frame = frame
    if camera is not None and pose is not None:
        request.view.camera.intrinsics.CopyFrom(camera._wire())
        try:
            request.view.camera.world_from_camera.CopyFrom(wire_pose(rigid(pose, "pose")))
        except ValueError as error:
            raise RequestError(str(error)) from None
    if near is not None:
        request.near_metres.CopyFrom(wire_vector(_numbers(near, "near")))
    if within is not None:
        least, most = (_numbers(corner, "within") for corner in within)
        request.within.min_metres.CopyFrom(wire_vector(least))
        request.within.max_metres.CopyFrom(wire_vector(most))
    return request


def export(
    name: str,
    kind: str,
    *,
    voxel: float | None = None,
    text: str = "",
    up: UpAxis | None = None,
    wait_seconds: float | None = None,
    min_sequence: int | None = None,
) -> v1.ExportRequest:
    """A request for a file."""
    return v1.ExportRequest(
        map=name,
        format=EXPORTS.get(kind, kind),
        voxel_metres=voxel,
        text=text,
        up=up or "",
        **waiting(wait_seconds, min_sequence),
    )


class _Waiting(TypedDict):
    wait: str
    min_sequence: int | None
    wait_seconds: float | None


def waiting(wait_seconds: float | None, min_sequence: int | None) -> _Waiting:
    """Waits for a frame if one is named, otherwise, if there is time, until the map has settled."""
    is_settled = wait_seconds is not None and min_sequence is None
    return {
        "wait": "settled" if is_settled else "",
        "min_sequence": min_sequence,
        "wait_seconds": wait_seconds,
    }


def _numbers(values: npt.ArrayLike, name: str) -> npt.NDArray[Any]:
    try:
        return numbers(values, (3,), name)
    except ValueError as error:
        raise RequestError(str(error)) from None
