"""Writes recordings with libraries that share nothing with lexsplat.

    bags.py FOLDER OUT KIND

FOLDER is in Replica layout; its poses are those of the color camera. KIND is one of:

    lenses    rosbags, SQLite: a color and a depth camera with lenses, 5 cm apart; FOLDER/depth
              has what the depth camera sees
    db3       rosbags, SQLite: raw pictures, aligned depth 3 ms later, TF; and other cameras
    mcap      rosbags, MCAP with zstd: JPEG, compressedDepth, odometry, static TF
    ros2      mcap-ros2-support: RGB and metres, a topic of poses
    protobuf  foxglove-sdk: foxglove.* in protobuf, lz4
    json      foxglove-sdk: foxglove.* in JSON
"""

import base64
import io
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

START = 1_700_000_000_000_000_000
INTERVAL = 1_000_000_000 // 30
CAMERA = "camera_color_optical_frame"


def rotation(x: float, y: float, z: float, w: float) -> np.ndarray:
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rigid(place: list[float], xyzw: list[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation(*(np.array(xyzw) / np.linalg.norm(xyzw)))
    pose[:3, 3] = place
    return pose


def quaternion(pose: np.ndarray) -> list[float]:
    """x, y, z, w: the eigenvector of Bar-Itzhack's matrix with the largest eigenvalue."""
    r = pose[:3, :3]
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    return [float(n) for n in np.linalg.eigh(k)[1][:, -1]]


MAP_FROM_ODOM = rigid([0.5, -0.2, 0.0], [0.0, 0.0, 0.1, 1.0])
BASE_FROM_LINK = rigid([0.1, 0.0, 0.4], [0.0, 0.05, 0.0, 1.0])
LINK_FROM_CAMERA = rigid([0.0, 0.015, 0.0], [-0.5, 0.5, -0.5, 0.5])


class Walk:
    """The frames of a folder in Replica layout."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.camera = json.loads((folder / "cam_params.json").read_text())["camera"]
        lines = (folder / "traj.txt").read_text().split("\n")
        self.poses = [np.array(line.split(), float).reshape(4, 4) for line in lines if line.strip()]

    def __len__(self) -> int:
        return len(self.poses)

    def nanos(self, frame: float) -> int:
        return START + int(frame * INTERVAL)

    def jpeg(self, frame: int) -> bytes:
        return (self.folder / f"results/frame{frame:06}.jpg").read_bytes()

    def rgb(self, frame: int) -> np.ndarray:
        return np.asarray(Image.open(io.BytesIO(self.jpeg(frame))).convert("RGB"))

    def millimetres(self, frame: int) -> np.ndarray:
        units = np.asarray(Image.open(self.folder / f"results/depth{frame:06}.png"))
        return np.rint(units / self.camera["scale"] * 1000).astype("<u2")

    def depth_png(self, frame: int) -> bytes:
        png = io.BytesIO()
        Image.fromarray(self.millimetres(frame)).save(png, "png")
        return png.getvalue()

    def pose(self, frame: float) -> np.ndarray:
        """The camera in the world, also between frames."""
        first = min(max(int(frame), 0), len(self) - 2)
        share = frame - first
        before, after = (np.array(quaternion(self.poses[first + i])) for i in (0, 1))
        after = after if before @ after > 0 else -after
        turned = (1 - share) * before + share * after
        moved = (1 - share) * self.poses[first][:3, 3] + share * self.poses[first + 1][:3, 3]
        return rigid(list(moved), list(turned))

    def odom_from_base(self, frame: float) -> np.ndarray:
        map_from_base = self.pose(frame) @ np.linalg.inv(BASE_FROM_LINK @ LINK_FROM_CAMERA)
        return np.linalg.inv(MAP_FROM_ODOM) @ map_from_base

    def moments(self) -> list[float]:
        """Times of poses, in frames: twice as many as frames, and none of them at a frame."""
        return [k / 2 + 0.12 for k in range(-1, 2 * len(self))]


COLOR_CAMERA = {"w": 160, "h": 120, "fx": 114.0, "fy": 115.0, "cx": 78.5, "cy": 60.0}
COLOR_LENS = ("plumb_bob", [-0.12, 0.02, 0.001, -0.002, 0.0])
DEPTH_CAMERA = {"w": 128, "h": 96, "fx": 84.0, "fy": 84.0, "cx": 63.0, "cy": 48.5}
DEPTH_LENS = ("equidistant", [0.02, -0.01, 0.0, 0.0])


class DepthWalk:
    """What a depth camera sees: depth%06d.png, camera.json, and its place beside color."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        described = json.loads((folder / "camera.json").read_text())
        self.camera = described["camera"]
        self.color_from_depth = np.array(described["color_from_depth"]).reshape(4, 4)

    def millimetres(self, frame: int) -> np.ndarray:
        units = np.asarray(Image.open(self.folder / f"depth{frame:06}.png"))
        return np.rint(units / self.camera["scale"] * 1000).astype("<u2")


def sampled(source: dict, camera: dict, lens: tuple[str, list[float]]) -> list[np.ndarray]:
    """Where in pictures of a pinhole camera the pixels of one with a lens lie: rows, columns."""
    columns, rows = np.meshgrid(np.arange(camera["w"]), np.arange(camera["h"]))
    xd = (columns - camera["cx"]) / camera["fx"]
    yd = (rows - camera["cy"]) / camera["fy"]
    model, d = lens
    x, y = xd.copy(), yd.copy()
    for _ in range(50):
        r2 = x * x + y * y
        if model == "plumb_bob":
            k1, k2, p1, p2, k3 = d
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            x, y = (
                (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
                (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
            )
        else:
            r = np.maximum(np.sqrt(r2), 1e-9)
            t = np.arctan(r)
            t2 = t * t
            bent = t * (1 + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))))
            x, y = xd * r / bent, yd * r / bent
    columns, rows = x * source["fx"] + source["cx"], y * source["fy"] + source["cy"]
    assert rows.min() >= 0 and rows.max() < source["h"] - 1, "the source sees too little"
    assert columns.min() >= 0 and columns.max() < source["w"] - 1, "the source sees too little"
    return [rows, columns]


def smooth(picture: np.ndarray, at: list[np.ndarray]) -> np.ndarray:
    """Bilinear interpolation."""
    top, left = (np.floor(one).astype(int) for one in at)
    down, across = (at[0] - top)[..., None], (at[1] - left)[..., None]
    upper = picture[top, left] * (1 - across) + picture[top, left + 1] * across
    lower = picture[top + 1, left] * (1 - across) + picture[top + 1, left + 1] * across
    return np.rint(upper * (1 - down) + lower * down).astype(np.uint8)


class Ros:
    """Messages of ROS 2, by rosbags."""

    def __init__(self, walk: Walk) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.walk = walk
        self.store = get_typestore(Stores.ROS2_HUMBLE)

    def new(self, name: str, **fields: object) -> object:
        return self.store.types[name](**fields)

    def header(self, nanos: int, frame_id: str) -> object:
        stamp = self.new("builtin_interfaces/msg/Time", sec=nanos // 10**9, nanosec=nanos % 10**9)
        return self.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)

    def image(self, nanos: int, frame_id: str, encoding: str, pixels: np.ndarray) -> object:
        return self.new(
            "sensor_msgs/msg/Image",
            header=self.header(nanos, frame_id),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels.strides[0],
            data=np.frombuffer(pixels.tobytes(), np.uint8),
        )

    def compressed(self, nanos: int, form: str, data: bytes) -> object:
        return self.new(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(nanos, CAMERA),
            format=form,
            data=np.frombuffer(data, np.uint8),
        )

    def info(
        self,
        nanos: int,
        frame_id: str,
        camera: dict | None = None,
        lens: tuple[str, list[float]] = ("plumb_bob", [0.0] * 5),
    ) -> object:
        c = camera or self.walk.camera
        k = np.array([c["fx"], 0, c["cx"], 0, c["fy"], c["cy"], 0, 0, 1], float)
        p = np.array([c["fx"], 0, c["cx"], 0, 0, c["fy"], c["cy"], 0, 0, 0, 1, 0], float)
        roi = self.new(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        return self.new(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(nanos, frame_id),
            height=c["h"],
            width=c["w"],
            distortion_model=lens[0],
            d=np.array(lens[1]),
            k=k,
            r=np.eye(3).ravel(),
            p=p,
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def place(self, name: str, pose: np.ndarray) -> object:
        x, y, z, w = quaternion(pose)
        turn = self.new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        x, y, z = (float(n) for n in pose[:3, 3])
        if name == "Pose":
            point = self.new("geometry_msgs/msg/Point", x=x, y=y, z=z)
            return self.new("geometry_msgs/msg/Pose", position=point, orientation=turn)
        vector = self.new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
        return self.new("geometry_msgs/msg/Transform", translation=vector, rotation=turn)

    def tf(self, nanos: int, *edges: tuple[str, str, np.ndarray]) -> object:
        transforms = [
            self.new(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(nanos, parent),
                child_frame_id=child,
                transform=self.place("Transform", pose),
            )
            for parent, child, pose in edges
        ]
        return self.new("tf2_msgs/msg/TFMessage", transforms=transforms)

    def static(self, link_from_depth: np.ndarray = LINK_FROM_CAMERA) -> object:
        return self.tf(
            self.walk.nanos(0),
            ("base_link", "camera_link", BASE_FROM_LINK),
            ("camera_link", CAMERA, LINK_FROM_CAMERA),
            ("camera_link", "camera_depth_optical_frame", link_from_depth),
        )

    def odometry(self, nanos: int, pose: np.ndarray) -> object:
        zero = self.new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.new("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        none = np.zeros(36)
        return self.new(
            "nav_msgs/msg/Odometry",
            header=self.header(nanos, "odom"),
            child_frame_id="base_link",
            pose=self.new(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self.place("Pose", pose),
                covariance=none,
            ),
            twist=self.new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none),
        )

    def db3(self):
        """Topic, time and message of each message of the bag."""
        walk = self.walk
        color, depth, aside = "/camera/color", "/camera/aligned_depth_to_color", "/camera/depth"
        yield "/tf_static", walk.nanos(0), self.static()
        for moment in walk.moments():
            nanos = walk.nanos(moment)
            edges = [
                ("map", "odom", MAP_FROM_ODOM),
                ("odom", "base_link", walk.odom_from_base(moment)),
            ]
            yield "/tf", nanos, self.tf(nanos, *edges)
        for frame in range(len(walk)):
            nanos, later = walk.nanos(frame), walk.nanos(frame) + 3_000_000
            rgb, millimetres = walk.rgb(frame), walk.millimetres(frame)
            bgr = np.ascontiguousarray(rgb[:, :, ::-1])
            yield f"{color}/image_raw", nanos, self.image(nanos, CAMERA, "bgr8", bgr)
            yield f"{color}/camera_info", nanos, self.info(nanos, CAMERA)
            yield (
                f"{depth}/image_raw",
                later,
                self.image(later, CAMERA, "16UC1", millimetres),
            )
            yield f"{depth}/camera_info", later, self.info(later, CAMERA)
            # Cameras that are not to be taken.
            own = "camera_depth_optical_frame"
            yield (
                f"{aside}/image_rect_raw",
                later,
                self.image(later, own, "16UC1", millimetres // 2),
            )
            yield (
                f"{aside}/camera_info",
                later,
                self.info(later, own, {**walk.camera, "fx": 90.0, "fy": 90.0}),
            )
            grey = np.ascontiguousarray(rgb[:, :, 1])
            infra = self.image(nanos, own, "mono8", grey)
            yield "/camera/infra1/image_rect_raw", nanos, infra

    def lenses(self):
        walk, depth_walk = self.walk, DepthWalk(self.walk.folder / "depth")
        own = "camera_depth_optical_frame"
        link_from_depth = LINK_FROM_CAMERA @ depth_walk.color_from_depth
        color_at = sampled(walk.camera, COLOR_CAMERA, COLOR_LENS)
        depth_at = sampled(depth_walk.camera, DEPTH_CAMERA, DEPTH_LENS)
        yield "/tf_static", walk.nanos(0), self.static(link_from_depth)
        for moment in walk.moments():
            nanos = walk.nanos(moment)
            yield "/odom", nanos, self.odometry(nanos, walk.odom_from_base(moment))
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            rgb = smooth(walk.rgb(frame), color_at)
            yield "/rgb/image_raw", nanos, self.image(nanos, CAMERA, "rgb8", rgb)
            color_info = self.info(nanos, CAMERA, COLOR_CAMERA, COLOR_LENS)
            yield "/rgb/camera_info", nanos, color_info
            rows, columns = (np.rint(at).astype(int) for at in depth_at)
            millimetres = np.ascontiguousarray(depth_walk.millimetres(frame)[rows, columns])
            yield "/depth/image_raw", nanos, self.image(nanos, own, "16UC1", millimetres)
            depth_info = self.info(nanos, own, DEPTH_CAMERA, DEPTH_LENS)
            yield "/depth/camera_info", nanos, depth_info

    def mcap(self):
        walk = self.walk
        yield "/tf_static", walk.nanos(0), self.static()
        for moment in walk.moments():
            nanos = walk.nanos(moment)
            yield "/odom", nanos, self.odometry(nanos, walk.odom_from_base(moment))
            wheel = self.tf(nanos, ("base_link", "wheel", rigid([moment, 0, 0], [0, 0, 0, 1])))
            yield "/tf", nanos, wheel
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            jpeg = self.compressed(nanos, "rgb8; jpeg compressed bgr8", walk.jpeg(frame))
            yield "/rgb/image_raw/compressed", nanos, jpeg
            yield "/rgb/camera_info", nanos, self.info(nanos, CAMERA)
            depth = self.compressed(
                nanos, "16UC1; compressedDepth png", bytes(12) + walk.depth_png(frame)
            )
            yield "/stereo/image_raw/compressedDepth", nanos, depth
            yield "/stereo/camera_info", nanos, self.info(nanos, CAMERA)


def rosbags(walk: Walk, out: Path, kind: str) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    ros = Ros(walk)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(out, version=9, storage_plugin=plugin)
    if kind == "mcap":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    messages = sorted(getattr(ros, kind)(), key=lambda message: message[1])
    with writer:
        connections = {}
        for topic, nanos, message in messages:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ros.store)
            writer.write(connections[topic], nanos, ros.store.serialize_cdr(message, name))


def ros2(walk: Walk, out: Path) -> None:
    from mcap_ros2.writer import Writer

    header = "std_msgs/Header header\n"
    inside = (
        "\n================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
        "\n================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
    )
    image = (
        "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        "uint8[] data"
    )
    roi = "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"
    info = (
        "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
        "sensor_msgs/RegionOfInterest roi"
        "\n================\nMSG: sensor_msgs/RegionOfInterest\n"
    )
    pose = (
        "geometry_msgs/Pose pose"
        "\n================\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\n"
        "geometry_msgs/Quaternion orientation"
        "\n================\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z"
        "\n================\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\n"
        "float64 w"
    )
    c = walk.camera
    with out.open("wb") as file, Writer(file) as writer:
        images = writer.register_msgdef("sensor_msgs/msg/Image", header + image + inside)
        infos = writer.register_msgdef("sensor_msgs/msg/CameraInfo", header + info + roi + inside)
        poses = writer.register_msgdef("geometry_msgs/msg/PoseStamped", header + pose + inside)

        def write(topic: str, schema: object, nanos: int, message: dict) -> None:
            stamp = {"sec": nanos // 10**9, "nanosec": nanos % 10**9}
            frame_id = "vslam" if topic == "/vslam/pose" else "camera"
            message["header"] = {"stamp": stamp, "frame_id": frame_id}
            writer.write_message(topic, schema, message, log_time=nanos, publish_time=nanos)

        def picture(encoding: str, pixels: np.ndarray) -> dict:
            height, width = pixels.shape[:2]
            step, data = pixels.strides[0], pixels.tobytes()
            fields = {"encoding": encoding, "is_bigendian": 0, "step": step, "data": data}
            return {"height": height, "width": width, **fields}

        for moment in walk.moments():
            pose = walk.pose(moment)
            x, y, z, w = quaternion(pose)
            place = dict(zip("xyz", (float(n) for n in pose[:3, 3]), strict=True))
            place = {"position": place, "orientation": {"x": x, "y": y, "z": z, "w": w}}
            write("/vslam/pose", poses, walk.nanos(moment), {"pose": place})
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            metres = walk.millimetres(frame).astype("<f4") / 1000
            metres[metres == 0] = np.nan
            write("/camera/rgb", images, nanos, picture("rgb8", walk.rgb(frame)))
            write("/camera/depth", images, nanos, picture("32FC1", metres))
            calibration = {
                "height": c["h"],
                "width": c["w"],
                "distortion_model": "plumb_bob",
                "d": [],
                "k": [c["fx"], 0, c["cx"], 0, c["fy"], c["cy"], 0, 0, 1],
                "r": [1, 0, 0, 0, 1, 0, 0, 0, 1],
                "p": [c["fx"], 0, c["cx"], 0, 0, c["fy"], c["cy"], 0, 0, 0, 1, 0],
                "binning_x": 0,
                "binning_y": 0,
                "roi": {
                    "x_offset": 0,
                    "y_offset": 0,
                    "height": 0,
                    "width": 0,
                    "do_rectify": False,
                },
            }
            write("/camera/camera_info", infos, nanos, calibration)


def matrices(camera: dict) -> dict[str, list[float]]:
    fx, fy, cx, cy = (float(camera[name]) for name in ("fx", "fy", "cx", "cy"))
    return {
        "K": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "D": [0.0] * 5,
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def protobuf(walk: Walk, out: Path) -> None:
    import foxglove
    from foxglove.channels import (
        CameraCalibrationChannel,
        CompressedImageChannel,
        FrameTransformChannel,
        RawImageChannel,
    )
    from foxglove.mcap import MCAPCompression, MCAPWriteOptions
    from foxglove.messages import (
        CameraCalibration,
        CompressedImage,
        FrameTransform,
        Quaternion,
        RawImage,
        Timestamp,
        Vector3,
    )

    c, m = walk.camera, matrices(walk.camera)
    size = {"width": c["w"], "height": c["h"]}
    options = MCAPWriteOptions(compression=MCAPCompression.Lz4)
    with foxglove.open_mcap(out, writer_options=options):
        color = CompressedImageChannel("/color")
        depth = RawImageChannel("/depth")
        calibration = CameraCalibrationChannel("/calibration")
        place = FrameTransformChannel("/tf")
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            stamp = Timestamp(sec=nanos // 10**9, nsec=nanos % 10**9)
            named = {"timestamp": stamp, "frame_id": "camera"}
            pose = walk.poses[frame]
            x, y, z, w = quaternion(pose)
            px, py, pz = (float(n) for n in pose[:3, 3])
            place.log(
                FrameTransform(
                    timestamp=stamp,
                    parent_frame_id="world",
                    child_frame_id="camera",
                    translation=Vector3(x=px, y=py, z=pz),
                    rotation=Quaternion(x=x, y=y, z=z, w=w),
                ),
                log_time=nanos,
            )
            lens = CameraCalibration(
                **named,
                **size,
                distortion_model="plumb_bob",
                K=m["K"],
                D=m["D"],
                R=m["R"],
                P=m["P"],
            )
            calibration.log(lens, log_time=nanos)
            jpeg = CompressedImage(**named, data=walk.jpeg(frame), format="jpeg")
            color.log(jpeg, log_time=nanos)
            raw = RawImage(
                **named,
                **size,
                encoding="16UC1",
                step=c["w"] * 2,
                data=walk.millimetres(frame).tobytes(),
            )
            depth.log(raw, log_time=nanos)


def in_json(walk: Walk, out: Path) -> None:
    import foxglove
    from foxglove import Channel, Schema

    c = walk.camera
    size = {"width": c["w"], "height": c["h"]}

    def channel(topic: str, name: str) -> Channel:
        schema = Schema(name=f"foxglove.{name}", encoding="jsonschema", data=b'{"type": "object"}')
        return Channel(topic, schema=schema, message_encoding="json")

    with foxglove.open_mcap(out):
        color = channel("/color", "CompressedImage")
        depth = channel("/depth", "RawImage")
        calibration = channel("/calibration", "CameraCalibration")
        place = channel("/pose", "PoseInFrame")
        for frame in range(len(walk)):
            nanos = walk.nanos(frame)
            stamp = {"sec": nanos // 10**9, "nsec": nanos % 10**9}
            named = {"timestamp": stamp, "frame_id": "camera"}
            pose = walk.poses[frame]
            turn = dict(zip("xyzw", quaternion(pose), strict=True))
            position = dict(zip("xyz", (float(n) for n in pose[:3, 3]), strict=True))
            posed = {"position": position, "orientation": turn}
            world = {"timestamp": stamp, "frame_id": "world"}
            place.log({**world, "pose": posed}, log_time=nanos)
            lens = {"distortion_model": "plumb_bob", **matrices(c)}
            calibration.log({**named, **size, **lens}, log_time=nanos)
            jpeg = base64.b64encode(walk.jpeg(frame)).decode()
            color.log({**named, "data": jpeg, "format": "jpeg"}, log_time=nanos)
            data = base64.b64encode(walk.millimetres(frame).tobytes()).decode()
            raw = {"encoding": "16UC1", "step": c["w"] * 2, "data": data}
            depth.log({**named, **size, **raw}, log_time=nanos)


def main() -> None:
    folder, out, kind = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    walk = Walk(folder)
    if kind in ("db3", "mcap", "lenses"):
        rosbags(walk, out, kind)
    else:
        {"ros2": ros2, "protobuf": protobuf, "json": in_json}[kind](walk, out)


if __name__ == "__main__":
    main()
