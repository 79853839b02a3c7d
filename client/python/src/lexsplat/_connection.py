"""The connection to a server: address, secrets, retries, and errors in plain words."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import grpc
import grpc.aio

from lexsplat._errors import (
    AccessError,
    AddressError,
    BrokenError,
    BusyError,
    LexsplatError,
    NoServerError,
    NotFoundError,
    RequestError,
    ServerError,
)
from lexsplat.v1.lexsplat_pb2_grpc import MappingStub

T = TypeVar("T")
Code = grpc.StatusCode

DEFAULT_PORT = 50051
# Between two tries, seconds: the first pause, and the longest.
_FIRST_PAUSE = 0.2
_LONGEST_PAUSE = 5.0

_OPTIONS = [
    # Frames may be larger than gRPC's default of 4 MiB. The server has limits.
    ("grpc.max_receive_message_length", -1),
    ("grpc.max_send_message_length", -1),
    # A robot that leaves the network gets no packet that says so.
    ("grpc.keepalive_time_ms", 30_000),
    ("grpc.keepalive_timeout_ms", 10_000),
    ("grpc.initial_reconnect_backoff_ms", 200),
    ("grpc.min_reconnect_backoff_ms", 1_000),
    ("grpc.max_reconnect_backoff_ms", 5_000),
    # As with the command line: robots and servers are neighbours.
    ("grpc.enable_http_proxy", 0),
]


@dataclass(frozen=True)
class Access:
    """Where a server is, and who is calling.

    Attributes:
        address: HOST:PORT.
        encrypted: Whether it speaks TLS.
        token: What `lexsplat-server token` printed.
        authorities: Certificates (PEM) to trust in place of the usual ones.
        identity: A client certificate and its key (PEM).
    """

    address: str
    encrypted: bool
    token: str | None = None
    authorities: bytes | None = None
    identity: tuple[bytes, bytes] | None = None

    @classmethod
    def of(
        cls,
        address: str,
        port: int | None,
        token: str | None,
        ca: str | Path | bytes | None,
        identity: tuple[str | Path | bytes, str | Path | bytes] | None,
    ) -> Access:
        """Reads what a user gave; the token and `ca` may also be in the environment.

        Raises:
            AddressError: Something of it cannot be used.
        """
        token = os.environ.get("LEXSPLAT_TOKEN") if token is None else token
        if token is not None and not (token and token.isascii() and token.isprintable()):
            raise AddressError("token: it is empty, or has characters that no token has")
        ca = os.environ.get("LEXSPLAT_CA") if ca is None else ca
        target, scheme = _parse(address, port)
        if scheme == "http" and identity is not None:
            raise AddressError("identity: certificates are for https://, not for http://")
        pems = None if identity is None else (_pem(identity[0]), _pem(identity[1]))
        encrypted = scheme == "https" or (scheme is None and (ca or pems) is not None)
        return cls(target, encrypted, token, None if ca is None else _pem(ca), pems)

    def channel(self) -> grpc.aio.Channel:
        """A new connection; it is made at the first call."""
        if not self.encrypted:
            return grpc.aio.insecure_channel(self.address, options=_OPTIONS)
        certificate, key = self.identity or (None, None)
        credentials = grpc.ssl_channel_credentials(self.authorities, key, certificate)
        return grpc.aio.secure_channel(self.address, credentials, options=_OPTIONS)


def _parse(address: str, port: int | None) -> tuple[str, str | None]:
    wrong = AddressError(
        f"address: expected HOST, HOST:PORT, http://HOST:PORT or https://HOST:PORT, "
        f"found {address!r}"
    )
    scheme = None
    try:
        if "://" in address:
            scheme = address.split("://")[0]
        parts = urlsplit(address if scheme else f"//{address}")
        host, own_port = parts.hostname, parts.port
    except ValueError:
        raise wrong from None
    if scheme not in (None, "http", "https") or not host or parts.path not in ("", "/"):
        raise wrong
    host = f"[{host}]" if ":" in host else host
    return f"{host}:{own_port or port or DEFAULT_PORT}", scheme


def _pem(source: str | Path | bytes) -> bytes:
    if isinstance(source, bytes):
        return source
    try:
        return Path(source).read_bytes()
    except OSError as error:
        raise AddressError(f"cannot read the certificate {source}: {error.strerror}") from None


class Connection:
    """One connection, which all maps of a client share. It belongs to one event loop."""

    def __init__(self, access: Access, patience: float):
        self.access = access
        self.patience = patience
        # Whether the server ever answered: if not, there may be none.
        self.is_known = False
        self._channel: grpc.aio.Channel | None = None

    @property
    def stub(self) -> Any:
        """The calls of the service."""
        if self._channel is None:
            self._channel = self.access.channel()
        return MappingStub(self._channel)  # type: ignore[no-untyped-call]

    @property
    def metadata(self) -> list[tuple[str, str]]:
        """What each call carries."""
        token = self.access.token
        return [] if token is None else [("authorization", f"Bearer {token}")]

    async def call(self, call: Callable[[Any], Awaitable[T]]) -> T:
        """The result of a call, which is repeated while the server is away or loads the map.

        Raises:
            LexsplatError: The server refused, or patience is over.
        """
        patience = Patience(self)
        while True:
            try:
                result = await call(self.stub)
            except grpc.aio.AioRpcError as error:  # noqa: PERF203 (each turn may fail)
                await patience.wait(error)
            else:
                self.is_known = True
                return result

    async def close(self) -> None:
        """Ends the connection and what is under way on it."""
        if self._channel is not None:
            await self._channel.close()
            self._channel = None


class Patience:
    """How long a call goes on trying."""

    def __init__(self, connection: Connection):
        self._connection = connection
        self._since: float | None = None
        self._pause = _FIRST_PAUSE

    def renew(self) -> None:
        """Something went well."""
        self._since, self._pause = None, _FIRST_PAUSE

    async def wait(self, error: grpc.aio.AioRpcError, *, busy_seconds: float = 0.0) -> None:
        """Pauses before the next try.

        Args:
            error: Why the last try failed.
            busy_seconds: How long the map may have another sender: a connection that just broke
                is one for a while.

        Raises:
            LexsplatError: Another try would fail too, or there were enough.
        """
        now = asyncio.get_running_loop().time()
        self._since = now if self._since is None else self._since
        waited = now - self._since
        is_busy = error.code() is Code.ABORTED and waited < busy_seconds
        if not (is_temporary(error) or is_busy):
            raise translated(error, self._connection) from None
        is_over = waited >= self._connection.patience
        if is_over or (_is_unreachable(error) and not self._connection.is_known):
            raise translated(error, self._connection) from None
        await asyncio.sleep(self._pause)
        self._pause = min(2 * self._pause, _LONGEST_PAUSE)


def is_temporary(error: grpc.aio.AioRpcError) -> bool:
    """Whether the server is away, stopping or loading the map."""
    if error.code() is Code.UNAVAILABLE:
        return True
    # A connection that is cut in the middle of a message.
    return error.code() in (Code.INTERNAL, Code.UNKNOWN, Code.CANCELLED) and any(
        sign in (error.details() or "").lower()
        for sign in ("rst_stream", "stream removed", "error from core")
    )


def _is_unreachable(error: grpc.aio.AioRpcError) -> bool:
    details = (error.details() or "").lower()
    signs = ("failed to connect", "dns resolution failed", "connection refused", "handshake")
    return error.code() is Code.UNAVAILABLE and any(sign in details for sign in signs)


_ERRORS: dict[grpc.StatusCode, type[LexsplatError]] = {
    Code.NOT_FOUND: NotFoundError,
    Code.ABORTED: BusyError,
    Code.ALREADY_EXISTS: BusyError,
    Code.INVALID_ARGUMENT: RequestError,
    Code.OUT_OF_RANGE: RequestError,
}


def translated(error: grpc.aio.AioRpcError, connection: Connection) -> LexsplatError:
    """An error of gRPC in plain words."""
    address, details = connection.access.address, error.details() or ""
    if error.code() is Code.UNAUTHENTICATED:
        return AccessError(f"{details}; give token= or set LEXSPLAT_TOKEN")
    if error.code() is Code.PERMISSION_DENIED:
        return AccessError(details)
    if _is_unreachable(error):
        return NoServerError(f"no server at {address}: {_what_to_do(connection, details)}")
    if is_temporary(error):
        return BrokenError(
            f"the server at {address} does not answer as it should ({details}); acknowledged "
            "frames are in the map, and the same program goes on after them when the server is up"
        )
    return _ERRORS.get(error.code(), ServerError)(details or str(error.code()))


def _what_to_do(connection: Connection, details: str) -> str:
    if any(sign in details.lower() for sign in ("ssl", "tls", "certificate", "handshake")):
        return (
            f"no encrypted connection came about ({details}). A server speaks TLS if it has "
            "[server.tls]; ca= names its authority"
        )
    if connection.access.encrypted or "dns" in details.lower():
        return details
    return "start lexsplat-server, or give its gRPC address: Client('HOST:PORT')"
