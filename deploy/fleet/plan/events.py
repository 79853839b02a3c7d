"""The clock of a run, and queues. What comes to a queue now is told when it will be done."""

import heapq
import math
import random
from collections.abc import Callable
from itertools import count
from typing import Any


class Events:
    """Calls what is planned, in the order of time. The same seed repeats a run."""

    def __init__(self, seed: str) -> None:
        self.random = random.Random(seed)
        self.now = 0.0
        self.stopped = False
        self.planned: list[tuple[float, int, Callable[[Any], None], Any]] = []
        self.order = count()

    def at(self, when: float, what: Callable[[Any], None], argument: Any = None) -> None:
        heapq.heappush(self.planned, (when, next(self.order), what, argument))

    def run(self, end: float) -> None:
        while self.planned and not self.stopped:
            when, _, what, argument = heapq.heappop(self.planned)
            if when > end:
                break
            self.now = when
            what(argument)

    def exponential(self, mean: float) -> float:
        return self.random.expovariate(1 / mean) if mean > 0 else 0.0


class Processors:
    """Some cores that take work in the order in which it comes."""

    def __init__(self, cores: int) -> None:
        self.free = [0.0] * cores
        self.busy = 0.0

    def run(self, now: float, seconds: float) -> float:
        """When work that arrives now is done."""
        done = max(now, self.free[0]) + seconds
        heapq.heapreplace(self.free, done)
        self.busy += seconds
        return done


class GroupCommit:
    """A Raft group: while one batch is synced, what comes waits for the next one."""

    def __init__(self, sync_seconds: float, most: float) -> None:
        self.sync_seconds, self.most = sync_seconds, most
        self.begin = self.end = -1.0
        self.members = self.batches = 0

    def commit(self, now: float) -> float:
        """When a message that arrives now is on disk. Arrivals must be in order."""
        if now >= self.begin or self.members >= self.most:
            self.begin = max(now, self.end)
            self.end = self.begin + self.sync_seconds
            self.members = 0
            self.batches += 1
        self.members += 1
        return self.end


class Pool:
    """Checkpoints that are being written share what there is; none gets more than `most`."""

    def __init__(self, capacity: float, most: float, chunk: float, batch: float) -> None:
        self.capacity, self.most = capacity, most
        self.chunk, self.batch = chunk, max(chunk, batch)
        self.position = self.now = self.written = self.batches = 0.0
        self.writers: list[tuple[float, int, Any]] = []
        self.order = count()

    def rate(self) -> float:
        """Bytes per second of each writer."""
        return min(self.most, self.capacity / max(1, len(self.writers)))

    def advance(self, now: float) -> None:
        step = (now - self.now) * self.rate()
        written = step * len(self.writers)
        self.position += step
        self.written += written
        # A lone writer waits for the answer to each chunk. Otherwise batches are full.
        self.batches += written / (self.chunk if len(self.writers) == 1 else self.batch)
        self.now = now

    def add(self, now: float, size: float, who: Any) -> None:
        self.advance(now)
        heapq.heappush(self.writers, (self.position + size, next(self.order), who))

    def next_end(self) -> float:
        if not self.writers:
            return math.inf
        return self.now + max(0.0, self.writers[0][0] - self.position) / self.rate()

    def take(self, now: float) -> Any:
        self.advance(now)
        return heapq.heappop(self.writers)[2]
