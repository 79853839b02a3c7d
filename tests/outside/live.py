"""Serves a walk live, as foxglove_bridge does: ROS 2 over a WebSocket, by foxglove-sdk and rosbags.

    live.py FOLDER DEVICE CUT

FOLDER is in Replica layout. DEVICE names the driver whose topics are simulated:

    realsense  aligned depth, TF
    kinect     Azure Kinect: BGRA, depth of half the size with a camera of its own, no poses
    oak        depth in color's frame, odometry

The first line on standard output is the port. The first frame is repeated until the client has
chosen its topics and asks for no more of a camera that is not to be taken. Then the walk goes on at
10 frames a second. At frame CUT, if there is one, the server goes away, and comes back a second
later. "done" is printed after the last frame.
"""

import dataclasses
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import foxglove
import numpy as np
from bags import BASE_FROM_LINK, LINK_FROM_CAMERA, Ros, Walk
from foxglove import Channel, Schema

# Times as slow as the walk was.
SLOWER = 3
# Seconds after which a client has chosen its topics; it looks at them for two.
CHOSEN_WITHIN = 15
STILL = np.eye(4)

Message = tuple[str, int, object]


class Devices(Ros):
    """Topics, times and messages of cameras; the topic of color, and one to be left aside."""

    realsense_topics = ("/camera/color/image_raw", "/camera/infra1/image_rect_raw")
    kinect_topics = ("/rgb/image_raw", "/ir/image_raw")
    oak_topics = ("/oak/rgb/image_raw", "/oak/left/image_rect")

    def realsense(self) -> Iterator[Message]:
        yield from self.db3()

    def kinect(self) -> Iterator[Message]:
        walk = self.walk
        yield (
            "/tf_static",
            walk.nanos(0),
            self.tf(
                walk.nanos(0),
                ("camera_base", "depth_camera_link", STILL),
                ("camera_base", "rgb_camera_link", STILL),
            ),
        )
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            rgb, small = walk.rgb(frame), walk.millimetres(frame)[::2, ::2]
            bgra = np.dstack([rgb[:, :, ::-1], np.full(rgb.shape[:2], 255, np.uint8)])
            lens = self.info(nanos, "rgb_camera_link")
            yield "/rgb/image_raw", nanos, self.image(nanos, "rgb_camera_link", "bgra8", bgra)
            yield (
                "/rgb/camera_info",
                nanos,
                dataclasses.replace(lens, distortion_model="rational_polynomial", d=np.zeros(8)),
            )
            small = np.ascontiguousarray(small)
            own, height, width = "depth_camera_link", *small.shape
            yield "/depth/image_raw", nanos, self.image(nanos, own, "16UC1", small)
            # The pixels of small depth are those of color at even places.
            k, p = lens.k / 2, lens.p / 2
            k[8] = p[10] = 1
            half = dataclasses.replace(self.info(nanos, own), height=height, width=width, k=k, p=p)
            yield "/depth/camera_info", nanos, half
            infrared = np.ascontiguousarray(small // 4)
            yield "/ir/image_raw", nanos, self.image(nanos, own, "mono16", infrared)
            yield "/ir/camera_info", nanos, half

    def oak(self) -> Iterator[Message]:
        walk, own = self.walk, "oak_rgb_camera_optical_frame"
        yield (
            "/tf_static",
            walk.nanos(0),
            self.tf(
                walk.nanos(0),
                ("base_link", "oak-d-base-frame", BASE_FROM_LINK),
                ("oak-d-base-frame", own, LINK_FROM_CAMERA),
            ),
        )
        for moment in walk.moments():
            nanos = walk.nanos(moment)
            yield "/odom", nanos, self.odometry(nanos, walk.odom_from_base(moment))
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            rgb = walk.rgb(frame)
            bgr = np.ascontiguousarray(rgb[:, :, ::-1])
            yield "/oak/rgb/image_raw", nanos, self.image(nanos, own, "bgr8", bgr)
            yield "/oak/rgb/camera_info", nanos, self.info(nanos, own)
            depth = self.image(nanos, own, "16UC1", walk.millimetres(frame))
            yield "/oak/stereo/image_raw", nanos, depth
            yield "/oak/stereo/camera_info", nanos, self.info(nanos, own)
            grey = np.ascontiguousarray(rgb[:, :, 1])
            left = self.image(nanos, "oak_left_camera_optical_frame", "mono8", grey)
            yield "/oak/left/image_rect", nanos, left


class Listener:
    """Knows what the client has asked for."""

    def __init__(self, color: str, aside: str) -> None:
        self.color, self.aside = color, aside
        self.has_color = threading.Event()
        self.has_chosen = threading.Event()

    def on_subscribe(self, _client: object, channel: object) -> None:
        if channel.topic == self.color:
            self.has_color.set()

    def on_unsubscribe(self, _client: object, channel: object) -> None:
        if channel.topic == self.aside:
            self.has_chosen.set()


def serve(port: int, listener: Listener) -> object:
    return foxglove.start_server(
        name="robot", host="127.0.0.1", port=port, server_listener=listener
    )


def main() -> None:
    walk, device, cut = Walk(Path(sys.argv[1])), sys.argv[2], int(sys.argv[3])
    ros, channels = Devices(walk), {}
    color, aside = getattr(ros, f"{device}_topics")
    listener = Listener(color, aside)
    server = serve(0, listener)
    port = server.port
    print(port, flush=True)

    def log(topic: str, nanos: int, message: object) -> None:
        name = message.__msgtype__
        if topic not in channels:
            schema = Schema(name=name, encoding="ros2msg", data=b"")
            channels[topic] = Channel(topic, schema=schema, message_encoding="cdr")
        data = ros.store.serialize_cdr(message, name)
        channels[topic].log(bytes(data), log_time=nanos)

    messages = sorted(getattr(ros, device)(), key=lambda message: message[1])
    static = messages.pop([topic for topic, _, _ in messages].index("/tf_static"))
    begins = walk.nanos(0.5)
    at_most = time.monotonic() + CHOSEN_WITHIN
    while not listener.has_chosen.is_set() and time.monotonic() < at_most:
        for message in [static, *(m for m in messages if m[1] < begins)]:
            log(*message)
        time.sleep(0.1)
    before = begins
    for topic, nanos, message in messages:
        if nanos < begins:
            continue
        if topic == color and nanos == walk.nanos(cut):
            server.stop()
            listener.has_color.clear()
            time.sleep(1)
            server = serve(port, listener)
            listener.has_color.wait(60)
            log(*static)
        time.sleep(max(0, nanos - before) / 1e9 * SLOWER)
        before = nanos
        log(topic, nanos, message)
    print("done", flush=True)
    sys.stdin.read()
    server.stop()


if __name__ == "__main__":
    main()
