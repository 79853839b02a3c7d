"""Shows maps, trajectories and answers in Rerun, https://rerun.io: `pip install lexsplat[rerun]`.

    import rerun as rr
    import lexsplat.rerun

    rr.init("kitchen", spawn=True)
    lexsplat.rerun.log_map(kitchen)
    lexsplat.rerun.log_answer(kitchen.query("coffee mug"))

All positions are metres in the map's world. `recording` is that of `rr.init` if it is None.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import rerun as rr

from lexsplat._answer import Answer
from lexsplat._blocking import Map
from lexsplat._camera import Camera
from lexsplat._files import PointCloud, Trajectory
from lexsplat._geometry import quaternion, rigid

# Colors of a relevancy of 0, 0.5 and 1.
_COLORS = np.array([[48, 18, 59], [33, 145, 140], [253, 231, 37]], dtype=np.float64)
_POINT_METRES = 0.01


def log_map(
    shown: Map,
    *,
    path: str = "world",
    wait_seconds: float | None = None,
    recording: rr.RecordingStream | None = None,
) -> None:
    """Shows a map and where its frames were taken, at `path`/map and `path`/trajectory.

    The viewer's up is the axis of the map that is nearest to the map's.

    Raises:
        LexsplatError: There is no such map.
    """
    up = shown.status().up
    if up is not None:
        axis = int(np.argmax(np.abs(up.direction)))
        sense = "UP" if up.direction[axis] > 0 else "DOWN"
        axes = getattr(rr.ViewCoordinates, f"RIGHT_HAND_{'XYZ'[axis]}_{sense}")
        rr.log(path, axes, static=True, recording=recording)
    log_points(shown.points(wait_seconds=wait_seconds), path=f"{path}/map", recording=recording)
    log_trajectory(shown.trajectory(), path=f"{path}/trajectory", recording=recording)


def log_points(
    points: PointCloud, *, path: str = "world/map", recording: rr.RecordingStream | None = None
) -> None:
    """Shows the centres of a map's Gaussians."""
    shown = rr.Points3D(points.positions, colors=points.colors, radii=_POINT_METRES)
    rr.log(path, shown, static=True, recording=recording)


def log_trajectory(
    trajectory: Trajectory,
    *,
    path: str = "world/trajectory",
    recording: rr.RecordingStream | None = None,
) -> None:
    """Shows the camera's way as a line, and the camera on the time line `frame_time`."""
    line = rr.LineStrips3D([trajectory.poses[:, :3, 3]])
    rr.log(path, line, static=True, recording=recording)
    for seconds, pose in zip(trajectory.times, trajectory.poses, strict=True):
        rr.set_time("frame_time", duration=float(seconds), recording=recording)
        log_pose(pose, path=f"{path}/camera", recording=recording)
    rr.disable_timeline("frame_time", recording=recording)


def log_pose(
    pose: npt.ArrayLike,
    camera: Camera | None = None,
    *,
    path: str = "world/camera",
    recording: rr.RecordingStream | None = None,
) -> None:
    """Shows a camera at 4x4 `pose`, world_from_camera, now: for `on_frame` of a stream.

    Raises:
        ValueError: The matrix is no pose.
    """
    matrix = rigid(pose, "pose")
    moved = rr.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3])
    rr.log(path, moved, recording=recording)
    if camera is not None:
        lens = rr.Pinhole(
            resolution=[camera.width, camera.height],
            focal_length=[camera.fx, camera.fy],
            principal_point=[camera.cx, camera.cy],
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        rr.log(path, lens, recording=recording)


def log_answer(
    answer: Answer,
    *,
    path: str = "world/answer",
    recording: rr.RecordingStream | None = None,
) -> None:
    """Shows an answer: about a view, its heat map and boxes; about a map, its points and objects.

    Heat maps are at `path`/heatmap and boxes at `path`/heatmap/boxes, points at `path`/points, and
    objects at `path`/objects.
    """
    if answer.heatmap is not None:
        heat = rr.Image(_colors(answer.heatmap))
        rr.log(f"{path}/heatmap", heat, recording=recording)
        boxes = rr.Boxes2D(
            mins=np.reshape([(box.x, box.y) for box in answer.boxes], (-1, 2)),
            sizes=np.reshape([(box.width, box.height) for box in answer.boxes], (-1, 2)),
            labels=[f"{answer.text} {box.score:.2f}" for box in answer.boxes],
        )
        rr.log(f"{path}/heatmap/boxes", boxes, recording=recording)
    if answer.points is not None and answer.scores is not None:
        points = rr.Points3D(answer.points, colors=_colors(answer.scores), radii=2 * _POINT_METRES)
        rr.log(f"{path}/points", points, recording=recording)
        objects = rr.Boxes3D(
            centers=np.reshape([found.center for found in answer.objects], (-1, 3)),
            sizes=np.reshape([found.size for found in answer.objects], (-1, 3)),
            quaternions=[_quaternion(found.rotation) for found in answer.objects],
            labels=[f"{answer.text} {found.score:.2f}" for found in answer.objects],
        )
        rr.log(f"{path}/objects", objects, recording=recording)


def _quaternion(rotation: npt.NDArray[np.float64]) -> rr.Quaternion:
    w, x, y, z = quaternion(rotation)
    return rr.Quaternion(xyzw=[x, y, z, w])


def _colors(scores: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Red, green and blue of each relevancy, along a new last axis."""
    at = np.clip(scores, 0, 1) * (len(_COLORS) - 1)
    channels = [np.interp(at, np.arange(len(_COLORS)), channel) for channel in _COLORS.T]
    return np.stack(channels, axis=-1).astype(np.uint8)
