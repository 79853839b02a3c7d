"""Frames and cameras as messages, and the errors of wrong ones. Needs no server."""

import numpy as np
import pytest

import lexsplat
from lexsplat._frame import message
from lexsplat._geometry import pose_of, quaternion, rotation, wire_pose
from lexsplat._requests import opening
from lexsplat.v1 import lexsplat_pb2 as v1

SHAPE = (3, 4)
COLOR = np.arange(36, dtype=np.uint8).reshape(3, 4, 3)
DEPTH = np.arange(12, dtype=np.uint16).reshape(3, 4)


def turns(seed: int, count: int) -> np.ndarray:
    """Random rotations, half turns among them."""
    generator = np.random.default_rng(seed)
    made = [np.linalg.qr(generator.normal(size=(3, 3)))[0] for _ in range(count)]
    made = [turn * np.linalg.det(turn) for turn in made]
    return np.array(
        [*made, np.eye(3), *(np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1]))]
    )


def test_quaternions_are_rotations():
    for turn in turns(7, 500):
        w, x, y, z = quaternion(turn)
        again = rotation(v1.Quaternion(w=w, x=x, y=y, z=z))
        np.testing.assert_allclose(again, turn, atol=1e-12)
        # Negative control: the inverse is another rotation, unless it is a half turn or none.
        inverse = rotation(v1.Quaternion(w=w, x=-x, y=-y, z=-z))
        assert np.allclose(inverse, turn, atol=1e-6) == np.allclose(turn, turn.T, atol=1e-6)


def test_a_pose_comes_back():
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turns(3, 1)[0], (1, -2, 3)
    np.testing.assert_allclose(pose_of(wire_pose(pose)), pose, atol=1e-12)


def test_every_field_arrives():
    own = lexsplat.Camera(4, 3, 5, 6, 1, 2)
    frame = lexsplat.Frame(
        COLOR,
        DEPTH,
        time=1_764_000_000.25,
        pose=np.eye(4),
        covariance=np.arange(36.0).reshape(6, 6),
        labels=DEPTH,
        held_out=True,
        camera=own,
        depth_time=1_764_000_000.5,
        up=(0, -1, 0),
    )
    wire = message(frame, SHAPE, SHAPE)
    assert wire.timestamp_nanos == 1_764_000_000_250_000_000
    assert wire.depth_timestamp_nanos == 1_764_000_000_500_000_000
    assert wire.color == COLOR.tobytes() and wire.color_format == v1.COLOR_FORMAT_RGB8
    assert wire.depth == DEPTH.tobytes() and wire.depth_format == v1.DEPTH_FORMAT_U16
    assert wire.labels == DEPTH.tobytes() and wire.label_format == v1.LABEL_FORMAT_U16
    assert wire.pose_covariance[:] == list(range(36)) and wire.held_out
    assert (wire.intrinsics.fx, wire.intrinsics.fy) == (5, 6)
    assert (wire.up.x, wire.up.y, wire.up.z) == (0, -1, 0)
    assert wire.world_from_camera.rotation.w == 1


def test_the_opening_has_every_field():
    color = lexsplat.Camera(
        4, 3, 5, 6, 1, 2, distortion="plumb_bob", coefficients=[0.1, 0, 0, 0, 0.2]
    )
    eye = lexsplat.Camera(2, 2, 5, 6, 1, 1, distortion="fisheye", coefficients=[1, 2, 3, 4])
    moved = np.eye(4)
    moved[0, 3] = 0.05
    wire = opening(
        "kitchen",
        color,
        {
            "poses": "given",
            "depth_camera": lexsplat.DepthCamera(eye, moved),
            "depth_unit": 0.00025,
            "depth_range": (0.3, 3),
            "no_depth": np.array([1, 65535], np.uint16),
            "up": (0, 0, 1),
            "label_texts": ["chair"],
        },
    )
    assert wire.pose_source == v1.POSE_SOURCE_GIVEN and wire.depth_unit_metres == 0.00025
    assert wire.distortion.model == v1.DISTORTION_MODEL_BROWN_CONRADY
    assert wire.distortion.coefficients[:] == [0.1, 0, 0, 0, 0.2]
    assert wire.depth_camera.distortion.model == v1.DISTORTION_MODEL_KANNALA_BRANDT
    assert wire.depth_camera.color_from_depth.translation_metres.x == 0.05
    assert (wire.min_depth_metres, wire.max_depth_metres, wire.up.z) == (0.3, 3, 1)
    assert wire.no_depth[:] == [1, 65535] and wire.label_texts[:] == ["chair"]
    plain = opening("kitchen", lexsplat.Camera(4, 3, 5, 6, 1, 2), {})
    assert plain.pose_source == v1.POSE_SOURCE_ESTIMATED and plain.depth_unit_metres == 0.001
    assert not any(plain.HasField(name) for name in ("distortion", "depth_camera", "up"))
    phone = opening("kitchen", color, {"depth_camera": lexsplat.SameLens(2, 1)}).depth_camera
    assert (phone.intrinsics.width, phone.intrinsics.fx) == (2, 0)


def test_depth_has_the_size_of_its_camera():
    wire = message(lexsplat.Frame(COLOR, DEPTH[:2]), SHAPE, (2, 4))
    assert len(wire.depth) == 16


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"color": COLOR[:2]}, r"color: expected shape \(3, 4, 3\).* found \(2, 4, 3\)"),
        ({"color": COLOR[..., 0]}, "grey image"),
        ({"color": np.dstack([COLOR, COLOR[..., :1]])}, "leave alpha out"),
        ({"color": COLOR.astype(float)}, "color: expected uint8"),
        ({"color": b"GIF89a"}, "JPEG or PNG"),
        ({"color": None}, "color: expected an array or bytes, found NoneType"),
        ({"depth": DEPTH[:2]}, r"depth: expected shape \(3, 4\).*depth_camera="),
        ({"depth": DEPTH.astype(np.int32)}, "depth: expected uint16, or float in metres"),
        ({"depth": b"\xff\xd8\xff"}, "16-bit PNG"),
        ({"labels": DEPTH.astype(np.int16)}, "labels: expected uint8 or uint16"),
        ({"labels": DEPTH[1:]}, "labels: expected shape"),
        ({"time": -1.0}, "time: expected seconds"),
        ({"time": 1_764_000_000_000_000_000}, "are they nanoseconds"),
        ({"depth_time": float("nan")}, "depth_time: expected seconds"),
        ({"pose": np.eye(3)}, r"pose: expected shape \(4, 4\), found \(3, 3\)"),
        ({"pose": 2 * np.eye(4)}, "pose: expected the last row"),
        ({"pose": np.diag([2.0, 1, 1, 1])}, "no rotation"),
        ({"pose": np.diag([1.0, -1, 1, 1])}, "x right, y down, z forward"),
        ({"pose": np.full((4, 4), np.nan)}, "finite"),
        ({"pose": "here"}, "pose: expected numbers"),
        ({"covariance": np.eye(3)}, "covariance: expected shape"),
        ({"up": (0, 1)}, "up: expected shape"),
        ({"camera": lexsplat.Camera(8, 6, 5, 5, 1, 1)}, "camera: expected shape"),
    ],
)
def test_wrong_frames_are_refused(fields, reason):
    frame = lexsplat.Frame(**({"color": COLOR, "depth": DEPTH} | fields))
    with pytest.raises(lexsplat.FrameError, match=reason) as raised:
        message(frame, SHAPE, SHAPE)
    assert isinstance(raised.value, ValueError)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"width": 0}, "width: expected a number of pixels"),
        ({"height": 2.5}, "height: expected a number of pixels"),
        ({"fx": float("nan")}, "fx: expected pixels above 0"),
        ({"cy": float("inf")}, "cy: expected pixels"),
        ({"distortion": "barrel"}, "'barrel' is not one of brown_conrady, plumb_bob"),
        ({"coefficients": [0.1, 0, 0, 0]}, "coefficients without a model"),
        ({"distortion": "fisheye", "coefficients": [float("nan")] * 4}, "expected numbers"),
    ],
)
def test_wrong_cameras_are_refused(fields, reason):
    right = {"width": 4, "height": 3, "fx": 5, "fy": 5, "cx": 1, "cy": 1}
    with pytest.raises(lexsplat.CameraError, match=reason):
        lexsplat.Camera(**(right | fields))


def test_matrices_of_opencv_are_cameras():
    matrix = [[5, 0, 1], [0, 6, 2], [0, 0, 1]]
    camera = lexsplat.Camera.from_matrix(
        matrix, 4, 3, "plumb_bob", coefficients=np.array([[0.1, 0, 0, 0, 0]])
    )
    assert camera == lexsplat.Camera(
        4, 3, 5, 6, 1, 2, distortion="plumb_bob", coefficients=(0.1, 0, 0, 0, 0)
    )
    matrix[0][1] = 0.5
    with pytest.raises(lexsplat.CameraError, match="skew"):
        lexsplat.Camera.from_matrix(matrix, 4, 3)
    with pytest.raises(lexsplat.CameraError, match="shape"):
        lexsplat.Camera.from_matrix(np.eye(4), 4, 3)
    with pytest.raises(lexsplat.CameraError, match="rotation"):
        lexsplat.DepthCamera(camera, np.diag([1.0, 1, 2, 1]))
