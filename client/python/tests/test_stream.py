"""Streams of frames into a server."""

import logging

import numpy as np
import pytest

import lexsplat
from conftest import Room


def test_arrays_become_a_map_and_each_frame_is_acknowledged(new_map, room: Room):
    seen: list[lexsplat.FrameResult] = []
    summary = new_map.stream(
        room.frames(6), room.camera, poses="given", depth_unit=room.depth_unit, on_frame=seen.append
    )
    assert [result.sequence for result in seen] == list(range(6))
    assert list(summary.results) == seen
    assert (summary.frames, summary.tracked, summary.lost, summary.refusals) == (6, 6, 0, 0)
    assert seen[0].keyframe and summary.keyframes >= 1
    for number, result in enumerate(seen):
        np.testing.assert_allclose(result.pose, room.poses[number], atol=1e-6)
        assert result.covariance is None and result.durable_through is not None
    assert str(summary).startswith("6 frames: 6 tracked, 0 lost, 0 refused")
    status = new_map.status()
    assert status.frames_received == status.frames_tracked == 6


def test_poses_are_estimated(new_map, room: Room):
    frames = [room.frame(number, pose=None) for number in range(4)]
    frames[0].pose = room.poses[0]
    summary = new_map.stream(frames, room.camera, depth_unit=room.depth_unit)
    assert summary.tracked == 4
    for number, result in enumerate(summary.results):
        assert np.abs(result.pose - room.poses[number]).max() < 0.02
    assert summary.results[3].covariance.shape == (6, 6)


def test_files_and_arrays_in_other_forms_are_the_same_frames(client, room: Room):
    """JPEG and PNG bytes, float metres, views that are not contiguous, and big-endian numbers."""
    color, depth = room.color(0), room.depth(0)
    results = room.folder / "results"
    forms = {
        "files": (
            (results / "frame000000.jpg").read_bytes(),
            (results / "depth000000.png").read_bytes(),
        ),
        "metres": (color, depth.astype(np.float64) * room.depth_unit),
        "views": (
            np.repeat(color[..., ::-1], 2, axis=1)[:, ::2, ::-1],
            np.asfortranarray(depth).astype(">u2"),
        ),
        "arrays": (color, depth),
    }
    heat = {}
    for name, (of_color, of_depth) in forms.items():
        made = client.map(f"form-{name}")
        frame = lexsplat.Frame(of_color, of_depth, pose=np.eye(4))
        summary = made.stream([frame], room.camera, poses="given", depth_unit=room.depth_unit)
        assert summary.tracked == 1, summary.refused
        heat[name] = made.points(wait_seconds=120).positions
        made.delete()
    for name, positions in heat.items():
        assert abs(positions.mean() - heat["arrays"].mean()) < 0.05, name
    assert np.array_equal(heat["views"].shape, heat["arrays"].shape)


def test_a_refused_frame_is_told_and_the_stream_goes_on(new_map, room: Room, caplog):
    frames = list(room.frames(3))
    frames[1].color = b"\xff\xd8\xff no picture"
    with caplog.at_level(logging.WARNING, "lexsplat"):
        summary = new_map.stream(frames, room.camera, poses="given", depth_unit=room.depth_unit)
    (refused,) = summary.refused
    assert (refused.sequence, refused.refused_field) == (1, "color")
    assert refused.refused_reason and refused.refused_reason in caplog.text
    assert summary.tracked == 2


def test_what_is_probably_wrong_is_a_warning(new_map, room: Room):
    """Depth ten times too far, with poses of the right size."""
    with pytest.warns(lexsplat.InputWarning, match="unit"):
        new_map.stream(room.frames(), room.camera, poses="given", depth_unit=10 * room.depth_unit)
    assert any("unit" in warning for warning in new_map.status().input_warnings)


def test_the_same_program_goes_on_where_it_was(new_map, room: Room):
    def numbered(count):
        for number, frame in enumerate(room.frames(count)):
            frame.sequence = number
            yield frame

    options = {"poses": "given", "depth_unit": room.depth_unit}
    assert len(new_map.stream(numbered(3), room.camera, **options).results) == 3
    again = new_map.stream(numbered(5), room.camera, **options)
    assert again.skipped == 3 and [result.sequence for result in again.results] == [3, 4]
    assert "3 were in the map already" in str(again)
    # Frames without numbers come after the newest.
    more = new_map.stream([room.frame(5)], room.camera, **options)
    assert [result.sequence for result in more.results] == [5]


@pytest.mark.parametrize(("kept_bytes", "at_most"), [(None, 33), (1, 2)])
def test_frames_are_taken_as_the_server_takes_them(
    new_map, room: Room, monkeypatch, kept_bytes, at_most
):
    """As many are under way as are kept for another try, and one that waits to be sent."""
    if kept_bytes is not None:
        monkeypatch.setattr("lexsplat._upload.IN_FLIGHT_BYTES", kept_bytes)
    taken, acknowledged, most = 0, 0, 0

    def endless():
        nonlocal taken, most
        while taken < 120:
            taken += 1
            most = max(most, taken - acknowledged)
            yield lexsplat.Frame(room.color(0), room.depth(0), pose=room.poses[0])

    def count(_result):
        nonlocal acknowledged
        acknowledged += 1

    summary = new_map.stream(
        endless(), room.camera, poses="given", depth_unit=room.depth_unit, on_frame=count
    )
    assert len(summary.results) == 120
    assert 1 <= most <= at_most


def test_frames_are_pushed_one_by_one(new_map, room: Room):
    options = {"poses": "given", "depth_unit": room.depth_unit}
    with new_map.open(room.camera, **options) as stream:
        stream.send(room.frame(0))
        stream.send(room.frame(1))
    assert stream.summary.tracked == 2
    # An exception ends the stream, and is not hidden. The map can be opened at once.
    with pytest.raises(ZeroDivisionError), new_map.open(room.camera, **options):
        raise ZeroDivisionError
    stream = new_map.open(room.camera, **options)
    with pytest.raises(lexsplat.LexsplatError, match="with block"):
        stream.send(room.frame(2))


def test_a_map_has_one_sender_at_a_time(new_map, room: Room, monkeypatch):
    monkeypatch.setattr("lexsplat._upload.OPENING_SECONDS", 0.5)
    with new_map.open(room.camera), pytest.raises(lexsplat.BusyError, match="another sender"):
        new_map.stream([], room.camera)


def test_a_wrong_frame_is_an_error_of_the_program(new_map, room: Room):
    with pytest.raises(lexsplat.FrameError, match="no pose"):
        new_map.stream([room.frame(0, pose=None)], room.camera, poses="given")
    with pytest.raises(lexsplat.FrameError, match="they increase"):
        new_map.stream(
            [room.frame(0, sequence=4), room.frame(1, sequence=4)], room.camera, poses="given"
        )
    with pytest.raises(lexsplat.FrameError, match=r"expected lexsplat\.Frame, found tuple"):
        new_map.stream([(room.color(0), room.depth(0))], room.camera)
    with pytest.raises(TypeError, match="no such option: pose"):
        new_map.stream([], room.camera, pose="given")
    with pytest.raises(lexsplat.RequestError, match="depth_unit_metres"):
        new_map.stream([], room.camera, depth_unit=-1.0)


def test_labels_are_the_language(new_map, room: Room):
    things = np.zeros(room.camera.shape, dtype=np.uint8)
    things[:, : room.camera.width // 2] = 1
    frames = [room.frame(0, labels=things)]
    options = {"poses": "given", "depth_unit": room.depth_unit, "label_texts": ["chair"]}
    assert new_map.stream(frames, room.camera, **options).tracked == 1
    answer = new_map.query("chair", frame=0, smoothing=0, wait_seconds=120)
    left, right = np.array_split(answer.heatmap, 2, axis=1)
    assert left.mean() > right.mean() + 0.2
