"""The client for asyncio. The blocking client runs this one in a thread."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy.typing as npt

from lexsplat import _requests as requests
from lexsplat._answer import Answer, MapStatus, Segmentation
from lexsplat._camera import Camera
from lexsplat._connection import Access, Connection
from lexsplat._files import PointCloud, Trajectory
from lexsplat._frame import Frame
from lexsplat._requests import ExportFormat, StreamOptions, UpAxis
from lexsplat._results import OnFrame, Summary
from lexsplat._upload import Upload
from lexsplat.v1 import lexsplat_pb2 as v1

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack


class AsyncClient:
    """A connection to a lexsplat server, for asyncio. It belongs to one event loop.

    Args:
        address: HOST, HOST:PORT, http://HOST:PORT or https://HOST:PORT of the server's gRPC.
        port: Of gRPC, if the address has none; 50051 by default.
        token: What `lexsplat-server token` printed; by default that of the environment,
            LEXSPLAT_TOKEN.
        ca: Certificates (PEM; a file or bytes) to trust in place of the usual ones; by default the
            file LEXSPLAT_CA. With it, the connection is encrypted.
        identity: Certificate and key (PEM; files or bytes), for servers that ask for them.
        patience: How long calls and streams wait for a server that is away, or that loads a map
            after its start, seconds.

    Raises:
        AddressError: An argument cannot be used.
    """

    def __init__(
        self,
        address: str = "127.0.0.1",
        *,
        port: int | None = None,
        token: str | None = None,
        ca: str | Path | bytes | None = None,
        identity: tuple[str | Path | bytes, str | Path | bytes] | None = None,
        patience: float = 600.0,
    ):
        self._connection = Connection(Access.of(address, port, token, ca, identity), patience)

    def map(self, name: str) -> AsyncMap:
        """The map of this name, which need not exist yet: streaming into it creates it."""
        return AsyncMap(self._connection, name)

    async def maps(self) -> list[MapStatus]:
        """All maps that the token may see."""
        connection, request = self._connection, v1.ListMapsRequest()
        listed = await connection.call(
            lambda stub: stub.ListMaps(request, metadata=connection.metadata)
        )
        return [MapStatus._of(status) for status in listed.maps]

    async def close(self) -> None:
        """Ends the connection."""
        await self._connection.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()


class AsyncMap:
    """A map on a server, for asyncio."""

    def __init__(self, connection: Connection, name: str):
        self._name = name
        self._connection = connection

    @property
    def name(self) -> str:
        """Its name."""
        return self._name

    def open(
        self,
        camera: Camera,
        *,
        on_frame: OnFrame | None = None,
        **options: Unpack[StreamOptions],
    ) -> AsyncFrameStream:
        """A stream into the map, to send frames one by one: `async with kitchen.open(…) as stream`.

        Args:
            camera: The color camera.
            on_frame: Called with what became of each frame.
            **options: See `StreamOptions`.
        """
        opening = requests.opening(self.name, camera, options)
        return AsyncFrameStream(Upload(self._connection, opening, on_frame))

    async def stream(
        self,
        frames: AsyncIterable[Frame] | Iterable[Frame],
        camera: Camera,
        *,
        on_frame: OnFrame | None = None,
        **options: Unpack[StreamOptions],
    ) -> Summary:
        """Sends frames to the map, and waits until each is acknowledged.

        Frames are taken as the server can use them, so `frames` may be endless, and
        `tqdm(frames)` shows how far it is. If the connection breaks, the stream goes on after the
        newest frame that the map has. A frame that the server refuses is told of in the summary.

        Args:
            frames: Where frames come from. What is no asynchronous iterator is asked in a thread.
            camera: The color camera.
            on_frame: Called with what became of each frame.
            **options: See `StreamOptions`.

        Raises:
            LexsplatError: A frame or an option is wrong, the server refused, or was away too long.
        """
        async with self.open(camera, on_frame=on_frame, **options) as stream:
            async for frame in _each(frames):
                await stream.send(frame)
        return stream.summary

    async def query(
        self,
        text: str,
        *,
        frame: int | None = None,
        camera: Camera | None = None,
        pose: npt.ArrayLike | None = None,
        negatives: Sequence[str] = (),
        threshold: float | None = None,
        smoothing: int | None = None,
        max_objects: int | None = None,
        near: npt.ArrayLike | None = None,
        within: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        wait_seconds: float | None = None,
        min_sequence: int | None = None,
    ) -> Answer:
        """Where something is: in a view, or in the whole map in 3D.

        Args:
            text: What to look for, in plain words.
            frame: A view: the sequence number of a tracked frame.
            camera: A view: any camera, at `pose`.
            pose: 4x4 world_from_camera of `camera`.
            negatives: Texts to compare against; by default those of the server's networks.
            threshold: Relevancy above which something counts as found, 0 to 1.
            smoothing: Side of the mean filter over the heat map, pixels; 0 turns it off.
            max_objects: Most objects in the answer.
            near: 3D: objects are sorted by their distance to this point.
            within: 3D: smallest and largest corner of a box to look in.
            wait_seconds: Wait so long, 600 at most, until the map has done its work on all frames.
            min_sequence: Wait for this frame only.

        Raises:
            LexsplatError: There is no such map or frame, or the server refused.
        """
        request = requests.question(
            self.name,
            text=text,
            frame=frame,
            camera=camera,
            pose=pose,
            negatives=negatives,
            threshold=threshold,
            smoothing=smoothing,
            max_objects=max_objects,
            near=near,
            within=within,
            wait_seconds=wait_seconds,
            min_sequence=min_sequence,
        )
        return Answer._of(await self._query(request))

    async def segment(
        self,
        texts: Sequence[str],
        *,
        frame: int | None = None,
        camera: Camera | None = None,
        pose: npt.ArrayLike | None = None,
        threshold: float | None = None,
        wait_seconds: float | None = None,
        min_sequence: int | None = None,
    ) -> Segmentation:
        """Which of 1 to 32 texts fits each pixel of a view, or each Gaussian of the map, best.

        Args:
            texts: The texts.
            frame: A view: the sequence number of a tracked frame.
            camera: A view: any camera, at `pose`.
            pose: 4x4 world_from_camera of `camera`.
            threshold: Relevancy that the best text must have, 0 to 1.
            wait_seconds: Wait so long, 600 at most, until the map has done its work on all frames.
            min_sequence: Wait for this frame only.

        Raises:
            LexsplatError: There is no such map or frame, or the server refused.
        """
        request = requests.question(
            self.name,
            texts=texts,
            frame=frame,
            camera=camera,
            pose=pose,
            threshold=threshold,
            wait_seconds=wait_seconds,
            min_sequence=min_sequence,
        )
        return Segmentation._of(await self._query(request))

    async def _query(self, request: v1.QueryRequest) -> v1.QueryResponse:
        # An answer may be larger than what fits into one message.
        return v1.QueryResponse.FromString(await self._whole("QueryChunks", request))

    async def status(self) -> MapStatus:
        """How far the map is."""
        connection, request = self._connection, v1.GetMapRequest(name=self.name)
        return MapStatus._of(
            await connection.call(lambda stub: stub.GetMap(request, metadata=connection.metadata))
        )

    async def create(self) -> MapStatus:
        """Creates the map, empty. Streaming does so by itself."""
        connection, request = self._connection, v1.CreateMapRequest(name=self.name)
        return MapStatus._of(
            await connection.call(
                lambda stub: stub.CreateMap(request, metadata=connection.metadata)
            )
        )

    async def rename(self, name: str) -> AsyncMap:
        """Gives the map another name; the map of that name. The server saves it and loads it again.

        Raises:
            LexsplatError: The name is taken or invalid, somebody sends frames, or the server has
                no data directory.
        """
        connection = self._connection
        request = v1.RenameMapRequest(name=self.name, new_name=name)
        await connection.call(lambda stub: stub.RenameMap(request, metadata=connection.metadata))
        return AsyncMap(connection, name)

    async def delete(self) -> None:
        """Deletes the map and the recording of its frames."""
        connection, request = self._connection, v1.DeleteMapRequest(name=self.name)
        await connection.call(lambda stub: stub.DeleteMap(request, metadata=connection.metadata))

    async def export(
        self,
        kind: ExportFormat,
        path: str | os.PathLike[str],
        *,
        voxel: float | None = None,
        text: str = "",
        up: UpAxis | None = None,
        wait_seconds: float | None = None,
        min_sequence: int | None = None,
    ) -> Path:
        """Saves the map as a file, which is whole or not there; an old one is replaced.

        Args:
            kind: "ply", "splat", "spz", "glb" (Gaussians for viewers), "mesh", "points",
                "language", "tum" or "trajectory" (JSON).
            path: The file.
            voxel: Mesh: side of a voxel, metres; 0.02 by default.
            text: Mesh: a text whose relevancy becomes a property of the vertices.
            up: The axis of the file that points up; "map": the map's own coordinates. By default
                "y" for "glb", and "map" for all others.
            wait_seconds: Wait so long, 600 at most, until the map has done its work on all frames.
            min_sequence: Wait for this frame only.

        Raises:
            LexsplatError: There is no such map or format.
            OSError: The file cannot be written.
        """
        file = Path(path)
        data = await self._export(
            requests.export(
                self.name,
                kind,
                voxel=voxel,
                text=text,
                up=up,
                wait_seconds=wait_seconds,
                min_sequence=min_sequence,
            )
        )
        part = file.with_name(file.name + ".part")
        part.write_bytes(data)
        part.replace(file)
        return file

    async def trajectory(self, *, wait_seconds: float | None = None) -> Trajectory:
        """Where each tracked frame was taken; `wait_seconds` as for `query`."""
        request = requests.export(self.name, "trajectory", wait_seconds=wait_seconds)
        return Trajectory._of(await self._export(request))

    async def points(self, *, wait_seconds: float | None = None) -> PointCloud:
        """The centres of the map's Gaussians with their colors; `wait_seconds` as for `query`."""
        request = requests.export(self.name, "points", wait_seconds=wait_seconds)
        return PointCloud._of(await self._export(request))

    async def _export(self, request: v1.ExportRequest) -> bytes:
        return await self._whole("ExportMap", request)

    async def _whole(self, call: str, request: v1.QueryRequest | v1.ExportRequest) -> bytes:
        """What a call sends in chunks."""
        connection = self._connection

        async def whole(stub: object) -> bytes:
            chunks = getattr(stub, call)(request, metadata=connection.metadata)
            return b"".join([chunk.data async for chunk in chunks])

        return await connection.call(whole)


class AsyncFrameStream:
    """An open stream into a map. Leaving the block waits until each frame is acknowledged.

    An exception in the block ends the stream at once; acknowledged frames are in the map.
    """

    def __init__(self, upload: Upload):
        self._upload = upload

    @property
    def summary(self) -> Summary:
        """What became of the frames so far."""
        return self._upload.summary

    @property
    def camera(self) -> Camera | None:
        """The camera that the map uses, without distortion; None before the opening."""
        return self._upload.camera

    async def send(self, frame: Frame) -> None:
        """Sends a frame; waits while the server is behind.

        Raises:
            LexsplatError: The frame is wrong, or the stream has ended.
        """
        wire = self._upload.encode(frame)
        if wire is not None:
            await self._upload.send(wire)
        self._upload.deliver()

    async def __aenter__(self) -> Self:
        await self._upload.open()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                await self._upload.complete()
                while await self._upload.more():
                    self._upload.deliver()
        finally:
            await self._upload.close()


async def _each(frames: AsyncIterable[Frame] | Iterable[Frame]) -> AsyncIterator[Frame]:
    if isinstance(frames, AsyncIterable):
        async for frame in frames:
            yield frame
        return
    iterator = iter(frames)
    while (next_frame := await asyncio.to_thread(next, iterator, None)) is not None:
        yield next_frame
