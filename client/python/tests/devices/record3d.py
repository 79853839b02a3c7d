"""A simulated phone with LiDAR: the interface of record3d 1.4 as far as the example uses it."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
from recording import Recording


class Record3DStream:
    @staticmethod
    def get_connected_devices():
        return [SimpleNamespace(product_id=1)]

    def __init__(self):
        self._recording = Recording()
        self._number, self._is_over = -1, threading.Event()
        self._taken = threading.Semaphore(0)
        self.on_new_frame = self.on_stream_stopped = lambda: None

    def connect(self, _device):
        threading.Thread(target=self._play, daemon=True).start()
        return True

    def disconnect(self):
        self._is_over.set()
        self._taken.release()

    def _play(self):
        """A frame, as soon as the one before was taken; a real phone drops frames instead."""
        for number in range(self._recording.count):
            self._number = number
            self.on_new_frame()
            self._taken.acquire()
            if self._is_over.is_set():
                break
        self.on_stream_stopped()

    def get_rgb_frame(self):
        return self._recording.color(self._number)

    def get_depth_frame(self):
        depth = self._recording.depth(self._number, "phone").astype(np.float32)
        self._taken.release()
        return depth

    def get_intrinsic_mat(self):
        lens = self._recording.lenses["color"]
        return SimpleNamespace(fx=lens.fx, fy=lens.fy, tx=lens.cx, ty=lens.cy)
