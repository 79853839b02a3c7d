"""Maps what an iPhone or iPad with LiDAR sees: `record3d_live.py WORDS FRAMES [SERVER]`.

Needs the app Record3D with USB streaming switched on, and `pip install record3d`. Depth is smaller
than color and taken through the same lens; autofocus changes the lens from frame to frame.
"""

import sys
import threading
from collections.abc import Iterator
from typing import Any

import record3d

import lexsplat


class Phone:
    """The first phone at a USB port."""

    def __init__(self) -> None:
        self._news = threading.Event()
        self._is_over = False
        devices = record3d.Record3DStream.get_connected_devices()
        if not devices:
            raise SystemExit("no phone found: connect it by USB and start streaming in Record3D")
        self._stream: Any = record3d.Record3DStream()
        self._stream.on_new_frame = self._news.set
        self._stream.on_stream_stopped = self._stop
        self._stream.connect(devices[0])

    def _stop(self) -> None:
        self._is_over = True
        self._news.set()

    def frames(self) -> Iterator[lexsplat.Frame]:
        """What the phone sees, until streaming is switched off."""
        while True:
            self._news.wait()
            self._news.clear()
            if self._is_over:
                return
            lens, color = self._stream.get_intrinsic_mat(), self._stream.get_rgb_frame()
            height, width, _ = color.shape
            camera = lexsplat.Camera(width, height, lens.fx, lens.fy, lens.tx, lens.ty)
            yield lexsplat.Frame(color, self._stream.get_depth_frame(), camera=camera)

    def close(self) -> None:
        """Ends the stream."""
        self._stream.disconnect()


def main() -> None:
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    words, count, *server = sys.argv[1:]
    phone = Phone()
    frames = phone.frames()
    first = next(frames)
    if first.camera is None:
        raise SystemExit("the phone does not tell its camera")
    rows, columns = first.depth.shape if not isinstance(first.depth, bytes) else (0, 0)
    room = lexsplat.Client(*server).map("record3d")
    with room.open(first.camera, depth_camera=lexsplat.SameLens(columns, rows)) as stream:
        stream.send(first)
        for _, frame in zip(range(int(count) - 1), frames, strict=False):
            stream.send(frame)
    phone.close()
    print(stream.summary)
    print(room.query(words, wait_seconds=120).objects[:3])


if __name__ == "__main__":
    main()
