"""What is shown in Rerun, read back from the file that it writes."""

from collections import defaultdict
from pathlib import Path

import numpy as np
import rerun as rr
from rerun.chunk import RrdReader

import lexsplat
import lexsplat.rerun
from conftest import Room


def shown(path: Path) -> dict[str, dict[str, list]]:
    """Values of each component of each entity, by name, one for each time that it was logged."""
    entities: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            # Python's own times have no nanoseconds.
            is_time = name.endswith("_time")
            values = list(batch[name]) if is_time else batch[name].to_pylist()
            entities[chunk.entity_path][name] += values
    return entities


def test_a_map_its_trajectory_and_answers_are_shown(mapped, room: Room, tmp_path):
    recording = rr.RecordingStream("lexsplat-test")
    recording.save(tmp_path / "room.rrd")
    everywhere = mapped.query("chair", threshold=0.3, wait_seconds=120)
    view = mapped.query("chair", threshold=0.3, frame=0)
    lexsplat.rerun.log_map(mapped, recording=recording)
    lexsplat.rerun.log_answer(everywhere, recording=recording)
    lexsplat.rerun.log_answer(view, path="view", recording=recording)
    lexsplat.rerun.log_pose(room.poses[3], room.camera, recording=recording)
    recording.disconnect()

    found = shown(tmp_path / "room.rrd")
    assert found["/world"]["ViewCoordinates:xyz"], "the room's floor tells which way is up"
    (positions,) = found["/world/map"]["Points3D:positions"]
    np.testing.assert_allclose(positions, mapped.points().positions, atol=1e-6)
    (strips,) = found["/world/trajectory"]["LineStrips3D:strips"]
    np.testing.assert_allclose(strips[0], room.poses[:, :3, 3], atol=1e-5)
    assert len(found["/world/trajectory/camera"]["frame_time"]) == len(room.poses)
    (points,) = found["/world/answer/points"]["Points3D:positions"]
    np.testing.assert_allclose(points, everywhere.points, atol=1e-6)
    (centers,) = found["/world/answer/objects"]["Boxes3D:centers"]
    np.testing.assert_allclose(centers, [one.center for one in everywhere.objects], atol=1e-5)
    (labels,) = found["/world/answer/objects"]["Boxes3D:labels"]
    assert labels[0] == f"chair {everywhere.objects[0].score:.2f}"
    assert len(found["/view/heatmap"]["Image:buffer"][0][0]) == view.heatmap.size * 3
    assert len(found["/view/heatmap/boxes"]["Boxes2D:centers"][0]) == len(view.boxes) > 0
    (translation,) = found["/world/camera"]["Transform3D:translation"]
    np.testing.assert_allclose(translation[0], room.poses[3][:3, 3], atol=1e-5)
    assert found["/world/camera"]["Pinhole:resolution"] == [[[room.camera.width, 120.0]]]


def test_colors_tell_relevancies():
    low, middle, high = lexsplat.rerun._colors(np.array([-1, 0.5, 1], np.float32))
    assert low.tolist() == [48, 18, 59] and high.tolist() == [253, 231, 37]
    assert middle.tolist() == [33, 145, 140]


def test_an_answer_that_found_nothing_is_shown(mapped, tmp_path):
    recording = rr.RecordingStream("lexsplat-test")
    recording.save(tmp_path / "nothing.rrd")
    nowhere = mapped.query("chair", within=((90, 90, 90), (91, 91, 91)))
    lexsplat.rerun.log_answer(nowhere, recording=recording)
    recording.disconnect()
    found = shown(tmp_path / "nothing.rrd")
    assert found["/world/answer/points"]["Points3D:positions"] in ([[]], [None])
