"""What goes wrong on a network: connections that are cut, and servers that are away."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import grpc

from lexsplat.v1 import lexsplat_pb2 as v1
from lexsplat.v1.lexsplat_pb2_grpc import MappingServicer, add_MappingServicer_to_server


class Wire:
    """A piece of network between clients and a server, which can be cut."""

    def __init__(self, server: str):
        host, port = server.rsplit(":", 1)
        self._server = (host, int(port))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._sockets: list[socket.socket] = []
        self.connections = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Ends all connections; new ones can be made."""
        sockets, self._sockets = self._sockets, []
        for end in sockets:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def close(self) -> None:
        """Ends all connections for good."""
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(self._server)
            except OSError:
                return
            self.connections += 1
            self._sockets += [near, far]
            for source, target in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=(source, target), daemon=True).start()

    @staticmethod
    def _pump(source: socket.socket, target: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            pass


@contextmanager
def wire(server: str) -> Iterator[Wire]:
    """A wire to the server."""
    laid = Wire(server)
    try:
        yield laid
    finally:
        laid.close()


Call = Callable[[Iterator[v1.FrameMessage], grpc.ServicerContext], Iterator[v1.FrameAck]]


class Scripted(MappingServicer):
    """A server that plays a part in each call of `StreamFrames`, and is `away` at first."""

    def __init__(self, *calls: Call, away: int = 0):
        self._calls = list(calls)
        self._away = away
        self.opened: list[v1.OpenMap] = []

    def StreamFrames(self, request_iterator, context):  # noqa: N802 (the protocol's name)
        self.opened.append(next(request_iterator).open)
        yield from self._calls.pop(0)(request_iterator, context)

    def GetMap(self, request, context):  # noqa: N802 (the protocol's name)
        if self._away > 0:
            self._away -= 1
            context.abort(grpc.StatusCode.UNAVAILABLE, "map is being loaded: 3 of 7 frames")
        return v1.MapStatus(name=request.name)


@contextmanager
def serve(servicer: Scripted) -> Iterator[str]:
    """The address of a server for as long as the block lasts."""
    server = grpc.server(ThreadPoolExecutor(max_workers=4))
    add_MappingServicer_to_server(servicer, server)
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    try:
        yield f"127.0.0.1:{port}"
    finally:
        server.stop(None).wait()


def opened(through: int | None = None) -> v1.FrameAck:
    """The answer to an opening message."""
    return v1.FrameAck(status=v1.FRAME_STATUS_OPENED, received_through=through)


def tracked(message: v1.FrameMessage) -> v1.FrameAck:
    """The answer to a frame."""
    return v1.FrameAck(sequence=message.frame.sequence, status=v1.FRAME_STATUS_TRACKED)
