"""Frames on their way into a map, across broken connections.

A frame is kept until it is acknowledged, and at most `IN_FLIGHT` are kept. When the connection
breaks, the next one begins with the newest frame that the server says it has: what it has is
dropped here, what it lacks is sent again.
"""

from __future__ import annotations

import asyncio
import logging
import warnings
from collections import deque
from collections.abc import AsyncIterator, Callable

import grpc
import grpc.aio

from lexsplat._camera import Camera
from lexsplat._connection import Connection, Patience
from lexsplat._errors import BrokenError, ForgottenWarning, FrameError, InputWarning, LexsplatError
from lexsplat._frame import Frame, message
from lexsplat._results import FrameResult, OnFrame, Summary
from lexsplat.v1 import lexsplat_pb2 as v1

# Frames that are kept until they are acknowledged, and their bytes. Without compression a frame of
# 640x480 has 1.5 MB.
IN_FLIGHT = 32
IN_FLIGHT_BYTES = 128 << 20
# How long a map that is opened may have another sender: a stream that was just cut off ends when
# the server has taken the frames that were under way.
OPENING_SECONDS = 15.0

LOG = logging.getLogger("lexsplat")


class Upload:
    """A stream of frames into one map. All coroutines run in one event loop."""

    def __init__(self, connection: Connection, opening: v1.OpenMap, on_frame: OnFrame | None):
        self.summary = Summary()
        self.camera: Camera | None = None
        self._connection = connection
        self._opening = opening
        self._on_frame = on_frame
        self._changed = asyncio.Condition()
        # Not acknowledged, oldest first. The first `_sent` of them were sent on this connection.
        self._pending: deque[v1.Frame] = deque()
        self._sent = 0
        self._is_complete = False
        # Not delivered to the user yet.
        self._acks: deque[FrameResult | Warning] = deque()
        # The largest sequence numbers: taken here, in the map at the opening, and acknowledged.
        self._newest: int | None = None
        self._had: int | None = None
        self._acknowledged: int | None = None
        self._is_open = False
        # Of the connection in use. The messages of an older one come to their end.
        self._opened = asyncio.Event()
        self._running: asyncio.Task[None] | None = None
        self._telling: asyncio.Future[None] | None = None

    async def open(self) -> None:
        """Opens the map; waits while the server loads it.

        Raises:
            LexsplatError: The server refused, or there is none.
        """
        self._running = asyncio.create_task(self._run())
        # Whoever waits looks at how the task ended, so it is told afterwards.
        self._running.add_done_callback(self._ended)
        try:
            await self._until(lambda: self._is_open)
        except BaseException:
            # Cancelled: nobody will close what was not opened.
            await self.close()
            raise

    def encode(self, frame: Frame) -> v1.Frame | None:
        """A frame as the next message; None if the map has it already. Does not wait.

        Raises:
            FrameError: A type, shape or value is wrong.
        """
        color = self._opening.intrinsics
        depth = self._opening.depth_camera if self._opening.HasField("depth_camera") else None
        size = color if depth is None else depth.intrinsics
        wire = message(frame, (color.height, color.width), (size.height, size.width))
        if frame.sequence is None:
            sequence = 0 if self._newest is None else self._newest + 1
        else:
            sequence = int(frame.sequence)
            if self._had is not None and sequence <= self._had:
                self.summary.skipped += 1
                return None
            if not 0 <= sequence < 1 << 64 or (
                self._newest is not None and sequence <= self._newest
            ):
                raise FrameError(
                    f"sequence: they increase: expected more than {self._newest} and less than "
                    f"2**64, found {sequence}"
                )
        if self._opening.pose_source == v1.POSE_SOURCE_GIVEN and frame.pose is None:
            raise FrameError(
                f'frame {sequence} has no pose: give pose=, or poses="estimate" to the stream'
            )
        self._newest = wire.sequence = sequence
        return wire

    async def send(self, wire: v1.Frame) -> None:
        """Takes a frame, and waits while too many are not acknowledged.

        Raises:
            LexsplatError: The stream ended.
        """
        await self._until(self._has_room)
        self._pending.append(wire)
        await self._notify()

    async def complete(self) -> None:
        """No more frames come."""
        self._is_complete = True
        await self._notify()

    async def more(self) -> bool:
        """Waits for results; False when all were delivered.

        Raises:
            LexsplatError: The stream ended before its last frame was acknowledged.
        """
        await self._until(lambda: bool(self._acks) or self._is_done())
        return bool(self._acks)

    def deliver(self) -> None:
        """Hands the results that came meanwhile to the user, in the user's thread."""
        while self._acks:
            told = self._acks.popleft()
            if isinstance(told, Warning):
                warnings.warn(told, stacklevel=4)
                continue
            self.summary._count(told)
            if told.status == "refused":
                reason = f"{told.refused_field}: {told.refused_reason}"
                LOG.warning("frame %d was refused: %s", told.sequence, reason)
            if self._on_frame is not None:
                self._on_frame(told)

    async def close(self) -> None:
        """Ends the stream; frames that are not acknowledged may be lost."""
        if self._running is not None:
            self._running.cancel()
            await asyncio.gather(self._running, return_exceptions=True)

    def _has_room(self) -> bool:
        size = sum(len(frame.color) + len(frame.depth) for frame in self._pending)
        return len(self._pending) < IN_FLIGHT and size < IN_FLIGHT_BYTES

    def _is_done(self) -> bool:
        return self._is_complete and not self._pending

    async def _until(self, condition: Callable[[], bool]) -> None:
        running = self._running
        if running is None:
            raise LexsplatError("the stream is not open: use it in a with block")
        async with self._changed:
            await self._changed.wait_for(lambda: condition() or running.done())
        if not condition():
            if running.cancelled():
                raise LexsplatError("the stream was closed")
            running.result()
            raise LexsplatError("the stream has ended")

    async def _notify(self) -> None:
        async with self._changed:
            self._changed.notify_all()

    async def _run(self) -> None:
        patience = Patience(self._connection)
        while not self._is_done():
            try:
                await self._converse(patience)
            except grpc.aio.AioRpcError as error:  # noqa: PERF203 (each turn may fail)
                await patience.wait(error, busy_seconds=self._busy_seconds())

    def _ended(self, _task: asyncio.Task[None]) -> None:
        self._telling = asyncio.ensure_future(self._notify())

    def _busy_seconds(self) -> float:
        return self._connection.patience if self._is_open else OPENING_SECONDS

    async def _converse(self, patience: Patience) -> None:
        """One connection, until every frame is acknowledged."""
        opened = self._opened = asyncio.Event()
        connection = self._connection
        call = connection.stub.StreamFrames(self._messages(opened), metadata=connection.metadata)
        try:
            while (ack := await call.read()) is not grpc.aio.EOF:
                connection.is_known = True
                if ack.status == v1.FRAME_STATUS_OPENED:
                    self._resume(ack)
                    opened.set()
                else:
                    self._take(ack)
                # A server that opens the map and then fails at the same frame makes no progress.
                if ack.status != v1.FRAME_STATUS_OPENED or not self._pending:
                    patience.renew()
                await self._notify()
        finally:
            call.cancel()
            self._opened = asyncio.Event()
            opened.set()
            await self._notify()
        if not self._is_done():
            address = connection.access.address
            raise BrokenError(f"the server at {address} ended the stream before its last frame")

    async def _messages(self, opened: asyncio.Event) -> AsyncIterator[v1.FrameMessage]:
        yield v1.FrameMessage(open=self._opening)
        await opened.wait()
        while True:
            async with self._changed:
                await self._changed.wait_for(
                    lambda: (
                        self._sent < len(self._pending)
                        or self._is_complete
                        or self._opened is not opened
                    )
                )
            if self._opened is not opened or self._sent == len(self._pending):
                return
            frame = self._pending[self._sent]
            self._sent += 1
            yield v1.FrameMessage(frame=frame)

    def _resume(self, ack: v1.FrameAck) -> None:
        received = ack.received_through if ack.HasField("received_through") else None
        self._sent = 0
        if not self._is_open:
            self._had = self._newest = received
            self.camera = _camera(ack.camera) if ack.HasField("camera") else None
            self._is_open = True
            return
        acknowledged = self._acknowledged
        if acknowledged is not None and (received is None or received < acknowledged):
            has = "no frame" if received is None else f"frames up to {received}"
            self._acks.append(
                ForgottenWarning(
                    f"the server came back with {has}, but had acknowledged {acknowledged}: it "
                    "keeps frames only with --data-dir"
                )
            )
        while received is not None and self._pending and self._pending[0].sequence <= received:
            self._acknowledged = self._pending.popleft().sequence
            self._acks.append(FrameResult(self._acknowledged, "received"))

    def _take(self, ack: v1.FrameAck) -> None:
        if self._pending and self._pending[0].sequence == ack.sequence:
            self._pending.popleft()
            self._sent -= 1
            self._acks.append(FrameResult._of(ack))
            if ack.status != v1.FRAME_STATUS_REFUSED:
                self._acknowledged = ack.sequence
        self._acks.extend(InputWarning(warning.message) for warning in ack.input_warnings)


def _camera(wire: v1.Intrinsics) -> Camera:
    return Camera(wire.width, wire.height, wire.fx, wire.fy, wire.cx, wire.cy)
