"""Maps: how large they are, and what work on them costs."""

import random
from collections import deque
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

from costs import Costs

if TYPE_CHECKING:
    from workers import Worker


class Map:
    """A robot's session, and what its worker knows of it."""

    def __init__(self, costs: Costs, robot: int, phase: float, keyframes: int) -> None:
        self.robot, self.phase, self.keyframes = robot, phase, keyframes
        self.worker: Worker | None = None
        self.ended, self.live = False, True
        # Counts owners, so that what was planned for an earlier one is not done.
        self.turn = 0
        # Frames in the log; those that the newest checkpoint has; its size.
        self.logged = self.saved = self.saved_keyframes = 0
        self.saved_bytes = 0.0
        self.died = 0.0
        # Steps of the optimiser that keyframes have earned.
        self.owed = 0
        # Frames to replay that were acknowledged before, and times of sending of the others.
        self.silent = 0
        self.waiting: deque[float] = deque()
        self.grow(costs)

    def grow(self, costs: Costs) -> None:
        """Sets what depends on the number of Gaussians."""
        robots, worker = costs.robots, costs.worker
        self.gaussians = min(robots.max_gaussians, self.keyframes * robots.gaussians_per_keyframe)
        color = worker.step_seconds + worker.step_seconds_per_gaussian * self.gaussians
        language = (
            worker.language_step_seconds
            + worker.language_step_seconds_per_gaussian * self.gaussians
        )
        self.step = color + language / worker.language_every
        self.insert = worker.insert_seconds + worker.insert_seconds_per_gaussian * self.gaussians
        self.question = (
            worker.question_seconds + worker.question_seconds_per_gaussian * self.gaussians
        )

    def add_keyframe(self, costs: Costs) -> None:
        self.keyframes = min(self.keyframes + 1, costs.robots.max_keyframes)
        self.grow(costs)

    def whole_bytes(self, costs: Costs) -> float:
        """Size of a checkpoint of everything."""
        sizes = costs.checkpoint
        return self.keyframes * sizes.bytes_per_keyframe + self.gaussians * sizes.bytes_per_gaussian

    def written_bytes(self, costs: Costs) -> float:
        """Bytes that are written for the next checkpoint."""
        whole = self.whole_bytes(costs)
        if not costs.checkpoint.changed_only:
            return whole
        return whole - self.saved_keyframes * costs.checkpoint.bytes_per_keyframe


def mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def active_share(costs: Costs) -> float:
    """Share of time in which a robot drives."""
    robots = costs.robots
    return robots.session_seconds / (robots.session_seconds + robots.pause_seconds)


def keyframes_seen(costs: Costs, seconds: float) -> float:
    """Keyframes of a map that is so old."""
    robots = costs.robots
    return seconds * robots.moving_share * robots.keyframes_per_moving_second


@cache
def mean_checkpoint(costs: Costs) -> tuple[float, float]:
    """Bytes of a checkpoint of everything, and bytes that are written for one.

    Of maps at random moments of their sessions, or at their ends: the same distribution.
    """
    robots, sizes, chance = costs.robots, costs.checkpoint, random.Random("typical maps")
    seen = keyframes_seen(costs, robots.session_seconds)
    counts = [int(chance.expovariate(1 / seen)) if seen else 0 for _ in range(4000)]
    maps = [Map(costs, 0, 0.0, min(one, robots.max_keyframes)) for one in counts]
    whole = mean([one.whole_bytes(costs) for one in maps])
    if not sizes.changed_only:
        return whole, whole
    gaussians = mean([one.gaussians for one in maps])
    new = keyframes_seen(costs, sizes.period_seconds)
    return whole, gaussians * sizes.bytes_per_gaussian + new * sizes.bytes_per_keyframe
