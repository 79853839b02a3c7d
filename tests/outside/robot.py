#!/usr/bin/env python3
"""A robot in a few lines: streams a Replica-layout folder to a lexsplat server.

Needs `pip install grpcio grpcio-reflection` and nothing of lexsplat: the messages come from the
server's own reflection.

    robot.py 127.0.0.1:50051 MAP FOLDER [FRAMES] [--labels]

With --labels the folder's masks go along: each pixel's language is the class of its instance.
"""
import json
import sys

import grpc
from google.protobuf import descriptor_pool, message_factory
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import (
    ProtoReflectionDescriptorDatabase,
)

with_labels = "--labels" in sys.argv
address, name, folder, *rest = [word for word in sys.argv[1:] if word != "--labels"]
count = int(rest[0]) if rest else None

channel = grpc.insecure_channel(address)
pool = descriptor_pool.DescriptorPool(ProtoReflectionDescriptorDatabase(channel))


def message(kind):
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("lexsplat.v1." + kind))


FrameMessage, FrameAck = message("FrameMessage"), message("FrameAck")


def quaternion(r):
    """(w, x, y, z) of a rotation matrix given as three rows."""
    w = max(0.0, 1 + r[0][0] + r[1][1] + r[2][2]) ** 0.5 / 2
    if w > 1e-6:
        return w, (r[2][1] - r[1][2]) / 4 / w, (r[0][2] - r[2][0]) / 4 / w, (r[1][0] - r[0][1]) / 4 / w
    x = max(0.0, 1 + r[0][0] - r[1][1] - r[2][2]) ** 0.5 / 2
    y = max(0.0, 1 - r[0][0] + r[1][1] - r[2][2]) ** 0.5 / 2
    z = max(0.0, 1 - r[0][0] - r[1][1] + r[2][2]) ** 0.5 / 2
    return w, x, (y if r[0][1] > 0 else -y), (z if r[0][2] > 0 else -z)


def messages():
    camera = json.load(open(f"{folder}/cam_params.json"))["camera"]
    opening = FrameMessage()
    opening.open.map = name
    opening.open.depth_unit_metres = 1 / camera["scale"]
    opening.open.pose_source = 1  # POSE_SOURCE_GIVEN
    into = opening.open.intrinsics
    into.width, into.height = camera["w"], camera["h"]
    into.fx, into.fy, into.cx, into.cy = (camera[key] for key in ("fx", "fy", "cx", "cy"))
    if with_labels:
        things = {thing["id"]: thing["class"] for thing in json.load(open(f"{folder}/instances.json"))}
        opening.open.label_texts.extend(things.get(1 + n, "") for n in range(max(things)))
    yield opening
    for number, line in enumerate(open(f"{folder}/traj.txt")):
        if number == count:
            return
        pose = [float(value) for value in line.split()]
        one = FrameMessage()
        one.frame.sequence, one.frame.timestamp_nanos = number, number * 33_333_333
        one.frame.color_format, one.frame.depth_format = 1, 1  # JPEG, 16-bit PNG
        one.frame.color = open(f"{folder}/results/frame{number:06d}.jpg", "rb").read()
        one.frame.depth = open(f"{folder}/results/depth{number:06d}.png", "rb").read()
        if with_labels:
            one.frame.label_format = 1  # grey PNG
            one.frame.labels = open(f"{folder}/semantic/{number:06d}.png", "rb").read()
        turn, at = one.frame.world_from_camera.rotation, one.frame.world_from_camera.translation_metres
        turn.w, turn.x, turn.y, turn.z = quaternion([pose[0:3], pose[4:7], pose[8:11]])
        at.x, at.y, at.z = pose[3], pose[7], pose[11]
        yield one


stream = channel.stream_stream(
    "/lexsplat.v1.Mapping/StreamFrames",
    request_serializer=FrameMessage.SerializeToString,
    response_deserializer=FrameAck.FromString,
)
tracked = keyframes = 0
for ack in stream(messages()):
    tracked += ack.status == 2  # TRACKED
    keyframes += ack.keyframe
    if ack.status == 5:  # REFUSED
        print(f"frame {ack.sequence}: {ack.refused_field}: {ack.refused_reason}")
print(f"{tracked} frames tracked, {keyframes} keyframes")
