#!/usr/bin/env python3
"""Streams RGB-D frames from a folder to a lexsplat server, as a robot would.

Needs `pip install grpcio grpcio-reflection` and nothing of lexsplat: the message types come from
the server's own reflection. Replace `read_frames` and `Camera` by your robot's camera and poses.

The folder has Replica's layout: `cam_params.json`, `traj.txt` with a 4x4 pose (camera to world, row
by row) in each line, `results/frameNNNNNN.jpg` and `results/depthNNNNNN.png`.
`lexsplat synth --seed 7 FOLDER` makes one.
"""

import argparse
import json
import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import grpc
from google.protobuf import descriptor_pool, message_factory
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import (
    ProtoReflectionDescriptorDatabase,
)

# Values of the enumerations in proto/lexsplat/v1/lexsplat.proto.
POSE_SOURCE_GIVEN = 1
COLOR_FORMAT_JPEG = 1
DEPTH_FORMAT_PNG16 = 1
LABEL_FORMAT_PNG = 1
STATUS_TRACKED = 2
STATUS_REFUSED = 5
FRAME_NANOS = 33_333_333


@dataclass
class Camera:
    """A pinhole camera, in pixels, and the metres that one unit of its depth images stands for."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    depth_unit_metres: float


@dataclass
class RgbdFrame:
    """Encoded images of one frame, and its camera's pose (camera to world, in the map's frame)."""

    color_jpeg: bytes
    depth_png16: bytes
    quaternion_wxyz: tuple[float, float, float, float]
    position_metres: tuple[float, float, float]
    labels_png: bytes | None = None


class Bearer(grpc.StreamStreamClientInterceptor):
    """Sends the token with each call."""

    def __init__(self, token: str):
        self.header = ("authorization", f"Bearer {token}")

    def intercept_stream_stream(self, continuation, details, messages):
        metadata = [*(details.metadata or []), self.header]
        return continuation(details._replace(metadata=metadata), messages)


class Client:
    """A connection to lexsplat's gRPC server: encrypted if `ca` is a PEM file of its authority."""

    def __init__(self, address: str, token: str | None = None, ca: Path | None = None):
        if ca is None:
            self.channel = grpc.insecure_channel(address)
        else:
            credentials = grpc.ssl_channel_credentials(ca.read_bytes())
            self.channel = grpc.secure_channel(address, credentials)
        if token is not None:
            self.channel = grpc.intercept_channel(self.channel, Bearer(token))
        pool = descriptor_pool.DescriptorPool(ProtoReflectionDescriptorDatabase(self.channel))

        def message(name: str):
            return message_factory.GetMessageClass(
                pool.FindMessageTypeByName("lexsplat.v1." + name)
            )

        self.FrameMessage, self.FrameAck = message("FrameMessage"), message("FrameAck")

    def close(self) -> None:
        """Ends the connection. Python may hang at its end while a stream is still open."""
        self.channel.close()

    def stream(
        self,
        map_name: str,
        camera: Camera,
        frames: Iterator[RgbdFrame],
        label_texts: list[str] = (),
    ):
        """Sends frames into a map; yields an acknowledgement for the opening and for each frame."""
        call = self.channel.stream_stream(
            "/lexsplat.v1.Mapping/StreamFrames",
            request_serializer=self.FrameMessage.SerializeToString,
            response_deserializer=self.FrameAck.FromString,
        )
        return call(self._messages(map_name, camera, frames, label_texts))

    def _messages(self, map_name, camera, frames, label_texts):
        opening = self.FrameMessage()
        opening.open.map = map_name
        opening.open.depth_unit_metres = camera.depth_unit_metres
        opening.open.pose_source = POSE_SOURCE_GIVEN
        # Label n in the images of labels stands for text n - 1.
        opening.open.label_texts.extend(label_texts)
        for field in ("width", "height", "fx", "fy", "cx", "cy"):
            setattr(opening.open.intrinsics, field, getattr(camera, field))
        yield opening
        for sequence, frame in enumerate(frames):
            message = self.FrameMessage()
            message.frame.sequence, message.frame.timestamp_nanos = sequence, sequence * FRAME_NANOS
            message.frame.color_format, message.frame.color = COLOR_FORMAT_JPEG, frame.color_jpeg
            message.frame.depth_format, message.frame.depth = DEPTH_FORMAT_PNG16, frame.depth_png16
            if frame.labels_png is not None:
                message.frame.label_format, message.frame.labels = (
                    LABEL_FORMAT_PNG,
                    frame.labels_png,
                )
            pose = message.frame.world_from_camera
            pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z = (
                frame.quaternion_wxyz
            )
            position = pose.translation_metres
            position.x, position.y, position.z = frame.position_metres
            yield message


def quaternion_wxyz(r: list[list[float]]) -> tuple[float, float, float, float]:
    """The quaternion of a rotation matrix given as three rows."""
    w = max(0.0, 1 + r[0][0] + r[1][1] + r[2][2]) ** 0.5 / 2
    if w > 1e-6:
        return (
            w,
            (r[2][1] - r[1][2]) / 4 / w,
            (r[0][2] - r[2][0]) / 4 / w,
            (r[1][0] - r[0][1]) / 4 / w,
        )
    x = max(0.0, 1 + r[0][0] - r[1][1] - r[2][2]) ** 0.5 / 2
    y = max(0.0, 1 - r[0][0] + r[1][1] - r[2][2]) ** 0.5 / 2
    z = max(0.0, 1 - r[0][0] - r[1][1] + r[2][2]) ** 0.5 / 2
    return w, x, (y if r[0][1] > 0 else -y), (z if r[0][2] > 0 else -z)


def read_camera(folder: Path) -> Camera:
    """The camera of a folder in Replica's layout."""
    camera = json.loads((folder / "cam_params.json").read_text())["camera"]
    intrinsics = (camera[key] for key in ("w", "h", "fx", "fy", "cx", "cy"))
    return Camera(*intrinsics, depth_unit_metres=1 / camera["scale"])


def read_label_texts(folder: Path) -> list[str]:
    """The class of each instance of a folder in Replica's layout, by instance id from 1."""
    things = {
        thing["id"]: thing["class"] for thing in json.loads((folder / "instances.json").read_text())
    }
    return [things.get(instance, "") for instance in range(1, max(things) + 1)]


def read_frames(folder: Path, count: int | None, with_labels: bool) -> Iterator[RgbdFrame]:
    """The first `count` frames of a folder in Replica's layout, all if `None`."""
    lines = (folder / "traj.txt").read_text().splitlines()
    for number, line in enumerate(lines[:count]):
        pose = [float(value) for value in line.split()]
        labels = folder / f"semantic/{number:06d}.png"
        yield RgbdFrame(
            color_jpeg=(folder / f"results/frame{number:06d}.jpg").read_bytes(),
            depth_png16=(folder / f"results/depth{number:06d}.png").read_bytes(),
            quaternion_wxyz=quaternion_wxyz([pose[0:3], pose[4:7], pose[8:11]]),
            position_metres=(pose[3], pose[7], pose[11]),
            labels_png=labels.read_bytes() if with_labels else None,
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="a folder in Replica's layout")
    parser.add_argument(
        "--server",
        default="127.0.0.1:50051",
        help="address of the gRPC server (default: %(default)s)",
    )
    parser.add_argument(
        "--token",
        default=os.environ.get("LEXSPLAT_TOKEN"),
        help="token, if the server asks who is calling (default: LEXSPLAT_TOKEN)",
    )
    parser.add_argument(
        "--ca", type=Path, help="certificate (PEM) of the server's authority: encrypts the stream"
    )
    parser.add_argument("--map", default="kitchen", help="name of the map (default: %(default)s)")
    parser.add_argument("--frames", type=int, help="number of frames to send (default: all)")
    parser.add_argument(
        "--labels", action="store_true", help="send the folder's masks: language from given labels"
    )
    arguments = parser.parse_args()

    camera = read_camera(arguments.folder)
    label_texts = read_label_texts(arguments.folder) if arguments.labels else []
    frames = read_frames(arguments.folder, arguments.frames, arguments.labels)
    tracked = keyframes = 0
    with closing(Client(arguments.server, arguments.token, arguments.ca)) as client:
        for ack in client.stream(arguments.map, camera, frames, label_texts):
            tracked += ack.status == STATUS_TRACKED
            keyframes += ack.keyframe
            if ack.status == STATUS_REFUSED:
                why = f"{ack.refused_field}: {ack.refused_reason}"
                print(f"frame {ack.sequence} was refused: {why}")
            for warning in ack.input_warnings:
                print(f"frame {ack.sequence}: {warning.message}")
    print(f"{tracked} frames tracked, {keyframes} keyframes")


if __name__ == "__main__":
    main()
