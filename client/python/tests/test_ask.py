"""Questions, lists, exports, and maps that are not there."""

import numpy as np
import pytest

import lexsplat
from conftest import Room
from lexsplat._files import PointCloud


def test_a_view_is_answered_with_arrays(mapped, room: Room):
    answer = mapped.query("chair", frame=0, wait_seconds=120)
    assert answer.text == "chair" and answer.settled and answer.revision > 0
    assert answer.through == len(room.poses) - 1
    assert answer.heatmap.shape == answer.mask.shape == room.camera.shape
    assert answer.heatmap.dtype == np.float32 and 0 <= answer.heatmap.min() < 1
    peak = answer.peak
    assert answer.heatmap[int(peak.y), int(peak.x)] == pytest.approx(answer.heatmap.max())
    assert answer.points is None and answer.objects == []
    assert answer.uncertainty.shape == room.camera.shape
    assert 0 <= answer.uncertainty.min() < answer.uncertainty.max() <= 1
    # The mask is the heat map above the threshold, in the same order of pixels.
    assert np.array_equal(answer.mask, answer.heatmap > answer.threshold)
    for box in answer.boxes:
        inside = answer.mask[int(box.y) : int(box.y + box.height), int(box.x) :]
        assert inside[:, : int(box.width)].any()


def test_a_camera_anywhere_is_a_view(mapped, room: Room):
    small = lexsplat.Camera(64, 48, 50, 50, 31.5, 23.5)
    answer = mapped.query("chair", camera=small, pose=room.poses[0])
    assert answer.heatmap.shape == (48, 64)
    with pytest.raises(lexsplat.RequestError, match="camera= with pose="):
        mapped.query("chair", camera=small)
    with pytest.raises(lexsplat.RequestError, match="mirrors"):
        mapped.query("chair", camera=small, pose=np.diag([1.0, 1, -1, 1]))


def test_the_whole_map_is_answered_in_metres(mapped):
    answer = mapped.query("chair", threshold=0.3, wait_seconds=120)
    assert answer.heatmap is None and answer.mask is None and answer.boxes == []
    assert answer.uncertainty is None
    assert answer.points.shape == (len(answer.scores), 3)
    assert len(answer.objects) > 0
    for found in answer.objects:
        assert 0 < found.confidence < 1
        assert found.distance is None and found.center.shape == found.size.shape == (3,)
        np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-5)
        assert (found.aabb_min <= found.center).all() and (found.center <= found.aabb_max).all()
    near = mapped.query("chair", threshold=0.3, near=(0, 0, 0)).objects
    assert [found.distance for found in near] == sorted(found.distance for found in near)
    nowhere = mapped.query("chair", threshold=0.3, within=((90, 90, 90), (91, 91, 91)))
    assert nowhere.objects == [] and len(nowhere.points) == 0


def test_the_answer_says_how_the_text_was_understood(mapped):
    answer = mapped.query("Where is the purple chair next to the unicorn?")
    understood = answer.understood
    assert (understood.object, understood.attributes) == ("chair", ["purple"])
    assert (understood.relation, understood.others) == ("next to", ["unicorn"])
    assert not answer.present and answer.objects == [] and answer.reason
    assert mapped.query("chairs").understood.object == "chair"
    with pytest.raises(lexsplat.RequestError, match="not a chair"):
        mapped.query("not a chair")


def test_texts_are_compared(mapped, room: Room):
    view = mapped.segment(["chair", "floor"], frame=0)
    assert view.texts == ["chair", "floor"] and view.image.shape == room.camera.shape
    for label, share in enumerate(view.shares, 1):
        assert (view.image == label).mean() == pytest.approx(share, abs=1e-4)
    space = mapped.segment(["chair", "floor"])
    assert space.image is None and space.points.shape == (len(space.labels), 3)
    assert (space.labels == 2).mean() == pytest.approx(space.shares[1], abs=1e-4)


def test_maps_are_listed_exported_and_deleted(client, mapped, room: Room, tmp_path):
    assert "mapped" in [status.name for status in client.maps()]
    path = mapped.export("ply", tmp_path / "room.ply", wait_seconds=120)
    assert path.read_bytes().startswith(b"ply\n")
    assert [file.name for file in tmp_path.iterdir()] == ["room.ply"]
    mesh = mapped.export("mesh", tmp_path / "mesh.ply", voxel=0.1)
    assert b"element face" in mesh.read_bytes()[:900]
    trajectory = mapped.trajectory()
    assert trajectory.sequences.tolist() == list(range(len(room.poses)))
    np.testing.assert_allclose(trajectory.poses, room.poses, atol=1e-6)
    np.testing.assert_allclose(np.diff(trajectory.times), 1 / 30, atol=1e-6)
    points = mapped.points()
    assert points.positions.shape == points.colors.shape and points.colors.dtype == np.uint8
    assert len(points.positions) == mapped.status().gaussians
    with pytest.raises(lexsplat.RequestError, match=r"splats\.ply"):
        mapped.export("obj", tmp_path / "room.obj")
    assert not (tmp_path / "room.obj").exists()

    other = client.map("other")
    assert other.create().name == "other"
    with pytest.raises(lexsplat.BusyError, match="other"):
        other.create()
    other = other.rename("another")
    assert other.name == "another" and other.status().frames_received == 0
    with pytest.raises(lexsplat.NotFoundError):
        client.map("other").status()
    other.delete()
    assert "another" not in [status.name for status in client.maps()]


def test_a_map_knows_up(new_map, room: Room, tmp_path):
    options = {"poses": "given", "depth_unit": room.depth_unit}
    new_map.stream(room.frames(2), room.camera, up=(0, 0, 3), **options)

    def read(axis: str) -> np.ndarray:
        file = new_map.export("points", tmp_path / axis, up=axis, wait_seconds=120)
        return PointCloud._of(file.read_bytes()).positions

    own, turned = read("map"), read("y")
    up = new_map.status().up
    np.testing.assert_allclose(up.direction, (0, 0, 1), atol=1e-6)
    assert (up.source, up.confidence) == ("given", 1)
    assert len(own) == len(turned) > 0
    np.testing.assert_allclose(np.sort(turned[:, 1]), np.sort(own[:, 2]), atol=1e-4)
    assert not np.allclose(np.sort(turned[:, 1]), np.sort(own[:, 1]), atol=1e-2)
    with pytest.raises(lexsplat.RequestError, match="up"):
        new_map.export("points", tmp_path / "w", up="w")


def test_errors_say_what_to_do(client, mapped):
    with pytest.raises(lexsplat.NotFoundError, match='no map is called "missing"'):
        client.map("missing").query("chair")
    with pytest.raises(lexsplat.NotFoundError, match="999"):
        mapped.query("chair", frame=999)
    with pytest.raises(lexsplat.RequestError, match="threshold"):
        mapped.query("chair", threshold=7)
    with pytest.raises(lexsplat.RequestError, match="text"):
        mapped.query("")
    with pytest.raises(lexsplat.RequestError, match="name"):
        client.map("../etc").create()
