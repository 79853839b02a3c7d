"""Broken connections, servers that are away, tokens and TLS."""

import asyncio
import subprocess
import sys
import threading
import time

import grpc
import numpy as np
import pytest

import lexsplat
from conftest import Room, setting
from faults import Scripted, opened, serve, tracked, wire

CAMERA = lexsplat.Camera(4, 3, 4, 4, 1.5, 1)


def frames(count: int):
    for _ in range(count):
        yield lexsplat.Frame(np.zeros((3, 4, 3), np.uint8), np.ones((3, 4), np.uint16))


def sequences(summary: lexsplat.Summary) -> list[int]:
    return [result.sequence for result in summary.results]


def test_a_stream_goes_on_after_each_cut(address: str, new_map, room: Room):
    with wire(address) as cable, lexsplat.Client(cable.address, patience=60) as client:
        cut = client.map(new_map.name)

        def until_it_breaks():
            for number, frame in enumerate(room.frames()):
                if number in (3, 6, 9):
                    # The connection after the cut before.
                    while cable.connections < number // 3:
                        time.sleep(0.01)
                    cable.cut()
                yield frame

        options = {"poses": "given", "depth_unit": room.depth_unit}
        summary = cut.stream(until_it_breaks(), room.camera, **options)
        count = len(room.poses)
        assert sequences(summary) == list(range(count))
        assert cable.connections == 4
        status = cut.status()
        assert status.frames_tracked == status.frames_received == count
        assert status.frames_refused == 0, "no frame was sent twice"


def test_what_the_server_has_is_not_sent_again_and_the_rest_is():
    def loses_answers(messages, context):
        yield opened()
        first, _second, _third = (next(messages) for _ in range(3))
        yield tracked(first)
        context.abort(grpc.StatusCode.UNAVAILABLE, "the server is stopping")

    def is_busy(_messages, context):
        context.abort(grpc.StatusCode.ABORTED, "the map has another sender")
        yield

    def has_two(messages, _context):
        yield opened(through=1)
        yield from map(tracked, messages)

    script = Scripted(loses_answers, is_busy, has_two)
    with serve(script) as address, lexsplat.Client(address) as client:
        summary = client.map("kitchen").stream(frames(5), CAMERA)
    told = [(result.sequence, result.status) for result in summary.results]
    assert told == [(0, "tracked"), (1, "received"), *((n, "tracked") for n in (2, 3, 4))]
    assert len(script.opened) == 3 and script.opened[0] == script.opened[2]


def test_a_server_that_forgot_is_told_of():
    def dies(messages, context):
        yield opened()
        yield tracked(next(messages))
        context.abort(grpc.StatusCode.UNAVAILABLE, "")

    def is_new(messages, _context):
        yield opened()
        yield from map(tracked, messages)

    forgot = pytest.warns(lexsplat.ForgottenWarning, match="no frame, but had acknowledged 0")
    with serve(Scripted(dies, is_new)) as address, lexsplat.Client(address) as client, forgot:
        summary = client.map("kitchen").stream(frames(3), CAMERA)
    assert sequences(summary) == [0, 1, 2]


def test_calls_wait_for_a_map_that_is_loaded_but_not_for_ever():
    with serve(Scripted(away=2)) as address, lexsplat.Client(address) as client:
        assert client.map("kitchen").status().name == "kitchen"
    with serve(Scripted(away=1000)) as address, lexsplat.Client(address, patience=0.5) as client:
        kitchen = client.map("kitchen")
        with pytest.raises(lexsplat.BrokenError, match="3 of 7 frames"):
            kitchen.status()


def test_a_server_that_ends_early_is_an_error():
    def leaves(messages, _context):
        yield opened()
        yield tracked(next(messages))
        for _ in messages:
            pass

    with serve(Scripted(leaves)) as address, lexsplat.Client(address) as client:
        kitchen = client.map("kitchen")
        with pytest.raises(lexsplat.BrokenError, match="before its last frame"):
            kitchen.stream(frames(9), CAMERA)


def test_a_failure_of_the_server_ends_the_stream_with_its_reason():
    def fails(messages, context):
        yield opened()
        next(messages)
        context.abort(grpc.StatusCode.INTERNAL, "the server cannot write: no space left")

    # If the client is just sending, it learns only that the call ended, and asks again.
    with serve(Scripted(*[fails] * 20)) as address, lexsplat.Client(address) as client:
        kitchen = client.map("kitchen")
        with pytest.raises(lexsplat.ServerError, match="no space left"):
            kitchen.stream(frames(9), CAMERA)


def test_an_opening_that_is_cancelled_ends_on_the_server_too():
    ended = threading.Event()

    def hangs(_messages, context):
        context.add_callback(ended.set)
        assert ended.wait(60)
        yield opened()

    async def gives_up(address: str):
        async with lexsplat.AsyncClient(address) as client:
            opening = asyncio.create_task(client.map("kitchen").stream(frames(1), CAMERA))
            while not script.opened:
                await asyncio.sleep(0.01)
            opening.cancel()
            await asyncio.wait([opening])
            assert opening.cancelled()
            assert await asyncio.to_thread(ended.wait, 30), "the server still waits for frames"

    script = Scripted(hangs)
    with serve(script) as address:
        asyncio.run(gives_up(address))


def test_no_server_is_told_at_once():
    began = time.monotonic()
    with lexsplat.Client("127.0.0.1:1") as client:
        with pytest.raises(lexsplat.NoServerError, match="start lexsplat-server"):
            client.maps()
        with pytest.raises(lexsplat.NoServerError, match="start lexsplat-server"):
            client.map("kitchen").stream(frames(1), CAMERA)
    assert time.monotonic() - began < 60, "patience, ten minutes, is for servers that were there"


def test_tokens_and_certificates():
    guarded, token, ca = setting("GUARDED"), setting("TOKEN"), setting("CA")
    with lexsplat.Client(guarded, token=token, ca=ca) as client:
        own = client.map("own")
        own.stream([], CAMERA)
        assert [status.name for status in client.maps()] == ["own"]
        with pytest.raises(lexsplat.AccessError, match="other"):
            client.map("other").create()
        with pytest.raises(lexsplat.AccessError, match="lacks the scope admin"):
            own.delete()
    with lexsplat.Client(f"https://{guarded}", ca=ca) as nobody:
        with pytest.raises(lexsplat.AccessError, match="LEXSPLAT_TOKEN"):
            nobody.maps()
        with pytest.raises(lexsplat.AccessError, match="LEXSPLAT_TOKEN"):
            nobody.map("own").stream(frames(1), CAMERA)
    distrustful = lexsplat.Client(f"https://{guarded}", token=token)
    with pytest.raises(lexsplat.NoServerError, match="ca= names its authority"):
        distrustful.maps()
    distrustful.close()


def test_secrets_may_be_in_the_environment(monkeypatch):
    monkeypatch.setenv("LEXSPLAT_TOKEN", setting("TOKEN"))
    monkeypatch.setenv("LEXSPLAT_CA", setting("CA"))
    with lexsplat.Client(setting("GUARDED")) as client:
        client.maps()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"address": "ftp://robot"}, "address: expected HOST"),
        ({"address": ""}, "address: expected HOST"),
        ({"address": "robot:port"}, "address: expected HOST"),
        ({"address": "http://robot/v1/maps"}, "address: expected HOST"),
        ({"token": ""}, "token: it is empty"),
        ({"token": "a\nb"}, "token: it is empty, or has"),
        ({"ca": "/no/such.pem"}, "cannot read the certificate /no/such.pem"),
        ({"address": "http://robot", "identity": (b"", b"")}, "certificates are for https"),
    ],
)
def test_wrong_arguments_are_refused_at_once(arguments, reason):
    with pytest.raises(lexsplat.AddressError, match=reason):
        lexsplat.Client(**arguments)


def test_nothing_complains_when_a_program_ends_without_closing():
    with serve(Scripted()) as address:
        program = f"import lexsplat; lexsplat.Client({address!r}).map('kitchen').status()"
        command = [sys.executable, "-c", program]
        ended = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ended.stderr == ""
