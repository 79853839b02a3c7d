"""A server that is killed in the middle of a stream, and started again."""

import json
import socket
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import lexsplat
from conftest import Room, setting

ROOT = Path(__file__).resolve().parents[3]


class Server:
    """The program, with a data directory, always at the same port."""

    def __init__(self, data: Path):
        self._data = data
        with closing(socket.create_server(("127.0.0.1", 0))) as free:
            self.address = f"127.0.0.1:{free.getsockname()[1]}"
        self.start()

    def start(self) -> None:
        command = [setting("PROGRAM"), "--config", "configs/tiny.toml", "--data-dir", self._data]
        ports = ["--grpc", self.address, "--http", "127.0.0.1:0"]
        self._process = subprocess.Popen(
            [*command, *ports], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        assert json.loads(self._process.stdout.readline())["event"] == "ready"

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()


@pytest.fixture
def server(tmp_path):
    started = Server(tmp_path)
    yield started
    started.kill()


def test_a_stream_goes_on_after_the_server_was_killed(server: Server, room: Room):
    def frames():
        for number, frame in enumerate(room.frames()):
            if number == 5:
                server.kill()
                server.start()
            yield frame

    with lexsplat.Client(server.address, patience=120) as client:
        made = client.map("killed")
        summary = made.stream(frames(), room.camera, poses="given", depth_unit=room.depth_unit)
        assert [result.sequence for result in summary.results] == list(range(len(room.poses)))
        status = made.status()
        assert (status.frames_received, status.frames_refused) == (len(room.poses), 0)
        np.testing.assert_allclose(made.trajectory(wait_seconds=120).poses, room.poses, atol=1e-6)

        # Questions wait, too, while the server is away and loads the map.
        server.kill()
        server.start()
        assert made.query("chair", frame=0).heatmap.shape == room.camera.shape
