"""Finds the smallest fleet that does what is asked for, and what breaks first when fleets grow."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from costs import Costs
from failures import DEATHS, Failures
from simulation import WARM_UP, Measured, Scenario, Simulation

# Frames that one run simulates, about, within limits of its time.
SEARCH_FRAMES, SWEEP_FRAMES, FINAL_FRAMES = 60_000, 30_000, 150_000
LEAST_SECONDS, MOST_SECONDS = 60.0, 1800.0
# How long the run with deaths waits for the last take-over.
TAIL_SECONDS = 240.0
# Robots of the fleets whose limits are shown.
RUNGS = (1, 10, 20, 50, 100, 200, 500, 1000, 2000)


@dataclass(frozen=True, slots=True)
class Plan:
    """A fleet, and what came of two runs: an ordinary one and one with deaths."""

    costs: Costs
    robots: int
    workers: int
    spare: int
    gateways: int
    fits: bool
    usual: Measured
    failures: Failures


@dataclass(frozen=True, slots=True)
class Sweep:
    """Used shares of limits by robots; which one is first above the allowed share, and where."""

    limit: float
    rows: dict[int, dict[str, float]]
    first: str | None
    robots: int


def say(text: str) -> None:
    print(text, file=sys.stderr)


def run_seconds(costs: Costs, robots: int, frames: int) -> float:
    seconds = frames / (robots * costs.robots.frames_per_second)
    return min(MOST_SECONDS, max(LEAST_SECONDS, seconds))


def plan_of(costs: Costs, robots: int, seed: int) -> Plan:
    rate, gateway = robots * costs.robots.frames_per_second, costs.gateway
    cores = rate * costs.to_be_replaced.gateway_seconds_per_frame
    # One more than is needed, for when one is replaced. While workers are sought, enough of them.
    few = math.ceil(cores / gateway.cores)
    gateways, many = max(gateway.least, few + 1), 2 * few + 1

    def run(workers: int, gateways: int, frames: int) -> Measured:
        seconds = run_seconds(costs, robots, frames)
        return Simulation(costs, Scenario(robots, workers, gateways, seconds, seed)).run()

    def suffices(workers: int) -> bool:
        return run(workers, many, SEARCH_FRAMES).fits()

    say(f"{robots} robots: searching the number of workers")
    needed, fits = smallest(math.ceil(robots / costs.worker.max_maps), robots, suffices)
    spare = max(1, math.ceil(needed * costs.failure.spare_share))
    workers = needed + spare
    say(f"{robots} robots: measuring {workers} workers, {gateways} gateways")
    usual = run(workers, gateways, FINAL_FRAMES)
    # Workers die one after the other, about five in a hundred at a time, or one at a time.
    restart = costs.failure.restart_seconds
    apart = min(2 * restart, max(6.0, 20 * restart / workers))
    seconds = (DEATHS * apart + TAIL_SECONDS) / (1 - WARM_UP)
    dying = Scenario(robots, workers, gateways, seconds, seed, death_seconds=apart)
    with_deaths = Simulation(costs, dying)
    with_deaths.run()
    return Plan(costs, robots, workers, spare, gateways, fits, usual, with_deaths.failures)


def smallest(least: int, most: int, suffices: Callable[[int], bool]) -> tuple[int, bool]:
    """The smallest number from `least` to `most` that suffices, or `most` and false."""
    low, high, step = least - 1, least, max(1, least // 10)
    while not suffices(high):
        if high >= most:
            return most, False
        low, high, step = high, min(most, high + step), 2 * step
    return between(low, high, suffices), True


def between(low: int, high: int, suffices: Callable[[int], bool], share: float = 0.0) -> int:
    """The smallest number that suffices, or one that is larger by a share of it."""
    while high - low > max(1, low * share):
        middle = (low + high) // 2
        if suffices(middle):
            high = middle
        else:
            low = middle
    return high


def sweep(costs: Costs, plan: Plan, seed: int) -> Sweep:
    """Simulates growing fleets, with workers and gateways in proportion to a plan's."""
    limit = costs.target.limit_share

    @cache
    def shares(robots: int) -> dict[str, float]:
        say(f"what breaks first: {robots} robots")
        workers = math.ceil(robots * plan.workers / plan.robots)
        gateways = max(costs.gateway.least, math.ceil(robots * plan.gateways / plan.robots))
        seconds = run_seconds(costs, robots, SWEEP_FRAMES)
        return Simulation(costs, Scenario(robots, workers, gateways, seconds, seed)).run().limits()

    def breaks(robots: int) -> bool:
        return max(shares(robots).values()) >= limit

    rows = {robots: shares(robots) for robots in RUNGS}
    low = max((robots for robots in RUNGS if not breaks(robots)), default=0)
    if low == RUNGS[-1]:
        return Sweep(limit, rows, None, low)
    high = min(robots for robots in RUNGS if robots > low)
    found = between(low, high, breaks, share=0.05)
    return Sweep(limit, rows, max(shares(found), key=lambda name: shares(found)[name]), found)
