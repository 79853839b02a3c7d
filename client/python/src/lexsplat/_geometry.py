"""Poses and vectors, between numpy and the messages."""

import numpy as np
import numpy.typing as npt

from lexsplat.v1 import lexsplat_pb2 as v1

Array = npt.NDArray[np.float64]

# How far a matrix may be from a rotation: float32 matrices and printed ones are this good.
_ROTATION_TOLERANCE = 1e-3


def numbers(values: npt.ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Finite numbers of this shape.

    Raises:
        ValueError: Something else was given.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers of shape {shape}, found {values!r}") from None
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, found {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers, found {array.tolist()}")
    return array


def rigid(matrix: npt.ArrayLike, name: str) -> Array:
    """A 4x4 matrix of a rotation and a translation.

    Raises:
        ValueError: It is another kind of matrix.
    """
    pose = numbers(matrix, (4, 4), name)
    if not np.allclose(pose[3], (0, 0, 0, 1), atol=1e-6):
        raise ValueError(f"{name}: expected the last row (0, 0, 0, 1), found {pose[3].tolist()}")
    turn = pose[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=_ROTATION_TOLERANCE):
        raise ValueError(f"{name}: its upper left 3x3 is no rotation: {turn.tolist()}")
    if np.linalg.det(turn) < 0:
        raise ValueError(
            f"{name}: its rotation mirrors: the axes of the camera are x right, y down, z forward"
        )
    return pose


def quaternion(turn: Array) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation matrix. The largest of the four is computed first."""
    trace = float(np.trace(turn))
    squares = np.array([trace, turn[0, 0], turn[1, 1], turn[2, 2]])
    largest = int(np.argmax(squares))
    if largest == 0:
        parts = [
            1 + trace,
            turn[2, 1] - turn[1, 2],
            turn[0, 2] - turn[2, 0],
            turn[1, 0] - turn[0, 1],
        ]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        parts = [turn[k, j] - turn[j, k], 0.0, 0.0, 0.0]
        parts[1 + i] = 1 + turn[i, i] - turn[j, j] - turn[k, k]
        parts[1 + j] = turn[j, i] + turn[i, j]
        parts[1 + k] = turn[k, i] + turn[i, k]
    w, x, y, z = np.array(parts, dtype=np.float64) / np.linalg.norm(parts)
    return float(w), float(x), float(y), float(z)


def rotation(wire: v1.Quaternion) -> Array:
    """The rotation matrix of a unit quaternion."""
    w, x, y, z = wire.w, wire.x, wire.y, wire.z
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def wire_pose(pose: Array) -> v1.Pose:
    """A pose as a message."""
    w, x, y, z = quaternion(pose[:3, :3])
    return v1.Pose(
        rotation=v1.Quaternion(w=w, x=x, y=y, z=z), translation_metres=wire_vector(pose[:3, 3])
    )


def pose_of(wire: v1.Pose) -> Array:
    """A message as a 4x4 matrix."""
    pose = np.eye(4)
    pose[:3, :3] = rotation(wire.rotation)
    pose[:3, 3] = vector_of(wire.translation_metres)
    return pose


def wire_vector(vector: npt.ArrayLike) -> v1.Vector3:
    """A vector as a message."""
    x, y, z = np.asarray(vector, dtype=np.float64)
    return v1.Vector3(x=float(x), y=float(y), z=float(z))


def vector_of(wire: v1.Vector3) -> Array:
    """A message as an array of three numbers."""
    return np.array([wire.x, wire.y, wire.z])
