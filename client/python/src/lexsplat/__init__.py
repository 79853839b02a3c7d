"""Streams RGB-D frames to a lexsplat server, and asks its maps questions in plain words.

    import lexsplat

    kitchen = lexsplat.Client("localhost").map("kitchen")
    kitchen.stream(frames, lexsplat.Camera(640, 480, 585, 585, 320, 240))
    answer = kitchen.query("coffee mug", frame=0)

`frames` yields `lexsplat.Frame(color, depth)`: numpy arrays as the camera gives them. `AsyncClient`
is the same for asyncio, and `lexsplat.rerun` shows maps and answers.
"""

from lexsplat._aio import AsyncClient, AsyncFrameStream, AsyncMap
from lexsplat._answer import (
    Answer,
    Box,
    MapStatus,
    Object,
    Peak,
    Segmentation,
    Understood,
    Up,
)
from lexsplat._blocking import Client, FrameStream, Map
from lexsplat._camera import Camera, DepthCamera, SameLens
from lexsplat._errors import (
    AccessError,
    AddressError,
    BrokenError,
    BusyError,
    CameraError,
    ForgottenWarning,
    FrameError,
    InputWarning,
    LexsplatError,
    NoServerError,
    NotFoundError,
    RequestError,
    ServerError,
)
from lexsplat._files import PointCloud, Trajectory
from lexsplat._frame import Frame
from lexsplat._requests import StreamOptions
from lexsplat._results import FrameResult, Summary

__all__ = [
    "AccessError",
    "AddressError",
    "Answer",
    "AsyncClient",
    "AsyncFrameStream",
    "AsyncMap",
    "Box",
    "BrokenError",
    "BusyError",
    "Camera",
    "CameraError",
    "Client",
    "DepthCamera",
    "ForgottenWarning",
    "Frame",
    "FrameError",
    "FrameResult",
    "FrameStream",
    "InputWarning",
    "LexsplatError",
    "Map",
    "MapStatus",
    "NoServerError",
    "NotFoundError",
    "Object",
    "Peak",
    "PointCloud",
    "RequestError",
    "SameLens",
    "Segmentation",
    "ServerError",
    "StreamOptions",
    "Summary",
    "Trajectory",
    "Understood",
    "Up",
]
