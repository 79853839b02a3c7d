"""Depth of a camera of its own, which the server registers, and lenses that bend."""

import numpy as np
import pytest

import lexsplat
from conftest import Room
from devices.recording import Recording, millimetres, seen

BENDS = (-0.22, 0.05, 0.002, -0.001, 0, 0, 0, 0)


@pytest.fixture(scope="session")
def recording() -> Recording:
    return Recording()


def camera(lens, *distortion) -> lexsplat.Camera:
    return lexsplat.Camera(
        *(getattr(lens, name) for name in ("width", "height", "fx", "fy", "cx", "cy")),
        *distortion,
        coefficients=lens.coefficients,
    )


def error(made: lexsplat.Map, room: Room, lens) -> float:
    """Metres between the map's points that the first frame sees and what is at their pixels.

    Of three quarters of the points: a few lie beside an edge.
    """
    points = made.points(wait_seconds=120).positions
    here = np.linalg.inv(room.poses[0])
    x, y, z = (points @ here[:3, :3].T + here[:3, 3]).T
    columns = np.rint(x / z * lens.fx + lens.cx)
    rows = np.rint(y / z * lens.fy + lens.cy)
    is_seen = (z > 0.1) & (columns >= 0) & (columns < lens.width)
    is_seen &= (rows >= 0) & (rows < lens.height)
    truth = room.depth(0)[rows[is_seen].astype(int), columns[is_seen].astype(int)]
    return float(np.percentile(np.abs(truth * room.depth_unit - z[is_seen]), 75))


def streamed(made: lexsplat.Map, room: Room, frames, *camera_arguments, **options) -> float:
    summary = made.stream(frames, *camera_arguments, poses="given", **options)
    assert summary.tracked == len(summary.results) > 0, summary.refused
    return error(made, room, Recording().lenses["color"])


def test_depth_of_another_camera_is_registered(client, new_map, room: Room, recording: Recording):
    color, depth = recording.lenses["color"], recording.lenses["depth"]
    own = lexsplat.DepthCamera(camera(depth), recording.color_from_depth)

    def frames():
        yield lexsplat.Frame(
            recording.color(0), millimetres(recording.depth(0)), pose=room.poses[0]
        )

    found = streamed(new_map, room, frames(), camera(color), depth_camera=own)
    assert found < 0.02
    # Negative control: depth is not where it seems to be without the cameras' relation.
    other = client.map("unrelated")
    unrelated = lexsplat.DepthCamera(camera(depth), np.eye(4))
    wrong = streamed(other, room, frames(), camera(color), depth_camera=unrelated)
    assert wrong > 3 * found
    other.delete()


def test_depth_of_a_phone_is_registered(new_map, room: Room, recording: Recording):
    color, phone = recording.lenses["color"], recording.lenses["phone"]
    frame = lexsplat.Frame(
        recording.color(0),
        recording.depth(0, "phone"),
        pose=room.poses[0],
        camera=camera(color),
    )
    small = lexsplat.SameLens(phone.width, phone.height)
    found = streamed(new_map, room, [frame], camera(color), depth_camera=small)
    assert found < 0.02


def test_a_lens_is_straightened(client, new_map, room: Room, recording: Recording):
    straight = recording.lenses["color"]
    bent = straight.scaled(straight.width, straight.height, BENDS)
    frame = lexsplat.Frame(
        seen(recording.color(0), straight, bent),
        millimetres(seen(room.depth(0) * room.depth_unit, straight, bent)),
        pose=room.poses[0],
    )
    described = camera(bent, "rational_polynomial")
    with new_map.open(described, poses="given") as stream:
        assert stream.camera.distortion is None
        assert stream.camera.shape == described.shape
    found = streamed(new_map, room, [frame], described)
    assert found < 0.02
    # Negative control: as if the lens were straight.
    other = client.map("bent")
    wrong = streamed(other, room, [frame], camera(straight))
    assert wrong > 3 * found
    other.delete()


def test_what_cannot_be_a_camera_is_refused_by_name(new_map, recording: Recording):
    lens = camera(recording.lenses["color"])
    with pytest.raises(lexsplat.RequestError, match=r"max_depth_metres|min_depth_metres"):
        new_map.stream([], lens, depth_range=(3.0, 0.3))
    with pytest.raises(lexsplat.RequestError, match="no_depth"):
        new_map.stream([], lens, no_depth=[70000])
