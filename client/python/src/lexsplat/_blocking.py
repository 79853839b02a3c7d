"""The blocking client: the asyncio client, which runs in a thread of its own."""

from __future__ import annotations

import asyncio
import functools
import threading
from collections.abc import Callable, Coroutine, Iterable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from lexsplat._aio import AsyncClient, AsyncMap
from lexsplat._camera import Camera
from lexsplat._frame import Frame
from lexsplat._requests import StreamOptions, opening
from lexsplat._results import OnFrame, Summary
from lexsplat._upload import Upload

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

P = ParamSpec("P")
T = TypeVar("T")


@functools.cache
def _loop() -> asyncio.AbstractEventLoop:
    """The event loop that all blocking clients of the process share."""
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="lexsplat", daemon=True).start()
    return loop


def _run(coroutine: Coroutine[Any, Any, T]) -> T:
    future = asyncio.run_coroutine_threadsafe(coroutine, _loop())
    try:
        return future.result()
    except BaseException:
        # Ctrl-C must not leave it running.
        future.cancel()
        raise


def _blocking(
    method: Callable[Concatenate[Any, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[Any, P], T]:
    """The same method, which waits for its result."""

    @functools.wraps(method)
    def waits(self: Any, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return _run(method(self._inner, *args, **kwargs))

    return waits


class Client:
    """A connection to a lexsplat server.

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
        self._inner = AsyncClient(
            address, port=port, token=token, ca=ca, identity=identity, patience=patience
        )

    def map(self, name: str) -> Map:
        """The map of this name, which need not exist yet: streaming into it creates it."""
        return Map(self._inner.map(name))

    maps = _blocking(AsyncClient.maps)
    close = _blocking(AsyncClient.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class Map:
    """A map on a server."""

    def __init__(self, inner: AsyncMap):
        self._inner = inner

    @property
    def name(self) -> str:
        """Its name."""
        return self._inner.name

    def open(
        self,
        camera: Camera,
        *,
        on_frame: OnFrame | None = None,
        **options: Unpack[StreamOptions],
    ) -> FrameStream:
        """A stream into the map, to send frames one by one: `with kitchen.open(…) as stream`.

        Args:
            camera: The color camera.
            on_frame: Called with what became of each frame, in this thread.
            **options: See `StreamOptions`.
        """
        upload = Upload(self._inner._connection, opening(self.name, camera, options), on_frame)
        return FrameStream(upload)

    def stream(
        self,
        frames: Iterable[Frame],
        camera: Camera,
        *,
        on_frame: OnFrame | None = None,
        **options: Unpack[StreamOptions],
    ) -> Summary:
        """Sends frames to the map, and waits until each is acknowledged.

        Frames are taken as the server can use them, in this thread, so `frames` may be endless, and
        `tqdm(frames)` shows how far it is. If the connection breaks, the stream goes on after the
        newest frame that the map has. A frame that the server refuses is told of in the summary.

        Args:
            frames: Where frames come from.
            camera: The color camera.
            on_frame: Called with what became of each frame, in this thread.
            **options: See `StreamOptions`.

        Raises:
            LexsplatError: A frame or an option is wrong, the server refused, or was away too long.
        """
        with self.open(camera, on_frame=on_frame, **options) as stream:
            for frame in frames:
                stream.send(frame)
        return stream.summary

    query = _blocking(AsyncMap.query)
    segment = _blocking(AsyncMap.segment)
    status = _blocking(AsyncMap.status)
    create = _blocking(AsyncMap.create)
    delete = _blocking(AsyncMap.delete)

    def rename(self, name: str) -> Map:
        """Gives the map another name; see `AsyncMap.rename`."""
        return Map(_run(self._inner.rename(name)))

    export = _blocking(AsyncMap.export)
    trajectory = _blocking(AsyncMap.trajectory)
    points = _blocking(AsyncMap.points)


class FrameStream:
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

    def send(self, frame: Frame) -> None:
        """Sends a frame; waits while the server is behind.

        Raises:
            LexsplatError: The frame is wrong, or the stream has ended.
        """
        wire = self._upload.encode(frame)
        if wire is not None:
            _run(self._upload.send(wire))
        self._upload.deliver()

    def __enter__(self) -> Self:
        _run(self._upload.open())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                _run(self._upload.complete())
                while _run(self._upload.more()):
                    self._upload.deliver()
        finally:
            _run(self._upload.close())
