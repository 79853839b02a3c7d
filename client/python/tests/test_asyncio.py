"""The client for asyncio: the same, without blocking."""

import asyncio
import inspect

import numpy as np
import pytest

import lexsplat
from conftest import Room


def test_the_same_calls(address: str, room: Room, tmp_path):
    async def use():
        async with lexsplat.AsyncClient(address, patience=60) as client:
            made = client.map("asyncio")
            summary = await made.stream(
                room.frames(4), room.camera, poses="given", depth_unit=room.depth_unit
            )
            assert summary.tracked == 4
            answer, status, maps = await asyncio.gather(
                made.query("chair", frame=0, wait_seconds=120), made.status(), client.maps()
            )
            assert answer.heatmap.shape == room.camera.shape and status.frames_tracked == 4
            assert "asyncio" in [listed.name for listed in maps]
            assert (await made.export("spz", tmp_path / "map.spz")).stat().st_size > 0
            await made.delete()
            with pytest.raises(lexsplat.NotFoundError):
                await made.status()

    asyncio.run(use())


def test_frames_may_come_from_asyncio_and_the_loop_stays_free(address: str, room: Room):
    async def frames():
        for frame in room.frames(5):
            await asyncio.sleep(0.01)
            yield frame

    async def use():
        ticks, seen = 0, []

        async def tick():
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0.001)

        ticking = asyncio.create_task(tick())
        async with lexsplat.AsyncClient(address, patience=60) as client:
            made = client.map("asyncio-frames")
            options = {"poses": "given", "depth_unit": room.depth_unit}
            await made.stream(frames(), room.camera, on_frame=seen.append, **options)
            async with made.open(room.camera, **options) as stream:
                await stream.send(room.frame(5))
            assert stream.summary.results[0].sequence == 5
            await made.delete()
        ticking.cancel()
        assert ticks > 20 and [result.sequence for result in seen] == list(range(5))

    asyncio.run(use())


def test_a_cancelled_stream_lets_the_map_go(address: str, room: Room):
    async def endless():
        while True:
            yield lexsplat.Frame(room.color(0), room.depth(0), pose=np.eye(4))
            await asyncio.sleep(0.01)

    async def use():
        async with lexsplat.AsyncClient(address, patience=60) as client:
            made = client.map("asyncio-cancelled")
            options = {"poses": "given", "depth_unit": room.depth_unit}
            mapped = asyncio.Event()
            told = {"on_frame": lambda _result: mapped.set()}
            streaming = asyncio.create_task(made.stream(endless(), room.camera, **options, **told))
            await mapped.wait()
            streaming.cancel()
            await asyncio.wait([streaming])
            assert streaming.cancelled()
            summary = await made.stream([room.frame(1)], room.camera, **options)
            assert summary.tracked == 1 and summary.results[0].sequence > 0
            await made.delete()

    asyncio.run(use())


def test_both_clients_have_the_same_methods():
    for blocking, other in (
        (lexsplat.Client, lexsplat.AsyncClient),
        (lexsplat.Map, lexsplat.AsyncMap),
        (lexsplat.FrameStream, lexsplat.AsyncFrameStream),
    ):
        own = {name for name in dir(blocking) if not name.startswith("_")}
        assert own == {name for name in dir(other) if not name.startswith("_")}
        for name in own:
            methods = getattr(blocking, name), getattr(other, name)
            if all(map(callable, methods)):
                first, second = (list(inspect.signature(one).parameters) for one in methods)
                assert first == second, name
