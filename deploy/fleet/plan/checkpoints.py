"""Checkpoints: each map writes one a period after the last one was begun, or when that is done."""

import math
from typing import TYPE_CHECKING

from maps import Map, active_share, mean_checkpoint

if TYPE_CHECKING:
    from simulation import Simulation


class Checkpoints:
    def __init__(self, run: "Simulation") -> None:
        self.events, self.costs, self.pool = run.events, run.costs, run.nats.pool
        self.period = run.costs.checkpoint.period_seconds
        # Bytes per second of one checkpoint, when as many are written as usual.
        maps = run.scenario.robots * active_share(run.costs)
        _, self.mean_written = mean_checkpoint(run.costs)
        load = maps * self.mean_written / self.period
        share = math.inf if load < self.pool.capacity else self.pool.capacity / maps
        self.usual_rate = min(self.pool.most, share)
        # When the next one will be done, as planned last.
        self.next_end = math.inf

    def begin(self, new: Map, age: float) -> None:
        """Puts a map where it is between two checkpoints, as if the fleet had run for long."""
        now, whole = self.events.now, new.whole_bytes(self.costs)
        changed_only = self.costs.checkpoint.changed_only
        size = self.mean_written if changed_only else whole
        writing = size / self.usual_rate
        period = max(self.period, writing)
        since = self.events.random.random() * period if age else 0.0
        is_writing = since < min(writing, age)
        saved_since = since + period if is_writing else since
        share = max(0.0, age - saved_since) / age if age else 0.0
        new.saved = int(new.logged * share)
        new.saved_keyframes = int(new.keyframes * share)
        new.saved_bytes = whole * share
        if is_writing:
            plan = (new, 0, new.logged, now - since)
            self.pool.add(now, size * (1 - since / writing), plan)
            self.plan()
        else:
            self.events.at(now + period - since, self.on_begin, (new, 0))

    def on_begin(self, plan: tuple[Map, int]) -> None:
        """A map copies its Gaussians from the device and begins to write a checkpoint."""
        of, turn = plan
        if of.ended or of.turn != turn:
            return
        now, costs = self.events.now, self.costs
        copied = of.gaussians * costs.checkpoint.bytes_per_gaussian
        of.worker.device.run(now, copied / costs.to_be_replaced.readback_bytes_per_second)
        self.pool.add(now, of.written_bytes(costs), (of, turn, of.logged, now))
        self.plan()

    def plan(self) -> None:
        self.next_end = self.pool.next_end()
        if self.next_end < math.inf:
            self.events.at(self.next_end, self.on_written, self.next_end)

    def on_written(self, planned: float) -> None:
        """A checkpoint is on disk, unless the plan has changed meanwhile."""
        if planned != self.next_end:
            return
        of, turn, logged, begun = self.pool.take(self.events.now)
        if not of.ended and of.turn == turn:
            of.saved, of.saved_keyframes = logged, of.keyframes
            of.saved_bytes = of.whole_bytes(self.costs)
            due = max(begun + self.period, self.events.now)
            self.events.at(due, self.on_begin, (of, turn))
        self.plan()
