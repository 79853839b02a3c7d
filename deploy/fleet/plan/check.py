"""Compares the simulation with closed forms, and shows it beside the one load test there is."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from costs import Costs
from maps import mean
from nats import Traffic
from simulation import WARM_UP, Scenario, Simulation

CHECK_FRAMES = 200_000
SERVICE = 0.01
TOLERANCE = 0.03
# What makes a fleet free of costs, and robots that send at random times.
FREE = {
    "to_be_replaced.gateway_seconds_per_frame": 0.0,
    "to_be_replaced.sync_seconds": 1e-12,
    "to_be_replaced.round_trip_seconds": 0.0,
    "to_be_replaced.claim_seconds": 0.0,
    "robots.arrivals": "poisson",
    "robots.session_seconds": 1e15,
    "robots.pause_seconds": 0.0,
    "robots.moving_share": 0.0,
    "robots.questions_per_second": 0.0,
    "robots.uplink_bytes_per_second": math.inf,
    "robots.uplink_seconds": 0.0,
    "gateway.cores": 1,
    "nats.disk_bytes_per_second": math.inf,
    "nats.network_bytes_per_second": 1e15,
    "worker.track_seconds": 0.0,
    "checkpoint.period_seconds": 1e15,
    "failure.lease_seconds": 1e15,
}
AT_GATEWAY = "to_be_replaced.gateway_seconds_per_frame"


class Comparison(NamedTuple):
    name: str
    simulated: float
    exact: float
    agrees: bool
    should: bool = True


class Endless(Simulation):
    """Its maps owe more steps than can be taken."""

    def begin(self) -> None:
        super().begin()
        for worker in self.mapping.workers:
            for of in worker.maps:
                of.owed = 10**12
                worker.device.queue(of)


class Young(Simulation):
    """All robots begin new maps at once, and everything is measured."""

    def begin(self) -> None:
        for robot in range(self.scenario.robots):
            self.robots.new_map(robot, 0.0)
        self.measured.on_warm(None)


def waits(costs: Costs) -> Iterator[Comparison]:
    """Mean waits, which those of M/D/1 are by Pollaczek and Khinchine."""

    def at(
        place: str,
        load: float,
        values: dict[str, Any],
        more: float = 0.0,
        kind: type[Simulation] = Simulation,
        should: bool = True,
    ) -> Comparison:
        # Queues that are long change slowly.
        frames, rate = CHECK_FRAMES if load < 0.7 else 5 * CHECK_FRAMES, load / SERVICE
        changed = costs.changed({**FREE, "robots.frames_per_second": rate, **values})
        run = kind(changed, Scenario(1, 1, 1, frames / rate, seed=7)).run()
        simulated = mean(run.latencies) - SERVICE + more
        exact = load * SERVICE / (2 * (1 - load)) + more / 2
        agrees = abs(simulated - exact) <= TOLERANCE * exact
        return Comparison(f"mean wait {place}, load {load}, s", simulated, exact, agrees, should)

    for load in (0.3, 0.6, 0.8):
        yield at("at a gateway", load, {AT_GATEWAY: SERVICE})
    yield at("at a worker", 0.6, {"worker.track_seconds": SERVICE})
    one_by_one = {"to_be_replaced.sync_seconds": SERVICE, "nats.batch_bytes": 1}
    yield at("at the log", 0.6, one_by_one)
    # A third of a frame's time is a step after its answer; idle time has more of them.
    step = SERVICE / 3
    optimiser = {
        "worker.track_seconds": SERVICE - step,
        "worker.step_seconds": step,
        "worker.language_step_seconds": 0.0,
    }
    yield at("beside the optimiser", 0.6, optimiser, step, Endless)
    yield at("if 5 % slower", 0.6, {AT_GATEWAY: 1.05 * SERVICE}, should=False)


def amounts(costs: Costs) -> Iterator[Comparison]:
    """Bytes that are stored and moved; take-overs when loading and replaying are free."""
    free = costs.changed({**FREE, "robots.frames_per_second": 4.0})
    periodic = free.changed({"robots.arrivals": "periodic"})
    stored = Simulation(periodic, Scenario(20, 2, 2, 100.0)).run().stored_bytes
    once = round(20 * 4 * 100 * (1 - WARM_UP)) * costs.robots.frame_bytes
    for copies, should in ((costs.nats.replicas, True), (costs.nats.replicas - 1, False)):
        exact = once * copies
        yield Comparison(f"bytes stored, {copies} copies", stored, exact, stored == exact, should)
    moved = Traffic(costs.nats, 3.0, 5.0)
    ways = ("into", moved.nodes_in, moved.into), ("out of", moved.nodes_out, moved.out)
    for way, nodes, outside in ways:
        total, exact = sum(nodes), outside + moved.between
        yield Comparison(f"bytes {way} nodes", total, exact, math.isclose(total, exact))
    often = {"checkpoint.period_seconds": 10.0, "failure.restart_seconds": 1.0}
    run = Simulation(
        free.changed({**often, "failure.lease_seconds": 6.0}),
        Scenario(40, 10, 2, 600.0, seed=3, death_seconds=20.0),
    )
    run.run()
    first, *_, last = run.failures.seconds_away()
    yield Comparison("shortest take-over, lease 6 s: at least", first, 4.0, first >= 4)
    yield Comparison("longest take-over, lease 6 s: at most", last, 6.0, last <= 6 + 1e-9)


def check(costs: Costs) -> bool:
    """Whether all agree but the two that have a wrong number on purpose."""
    good = True
    print(f"{'':48} {'simulated':12} {'exact':12}")
    for one in (*waits(costs), *amounts(costs)):
        good = good and one.agrees == one.should
        verdict = "agrees" if one.agrees else "DIFFERS"
        control = "" if one.should else " (must differ)"
        print(f"{one.name:48} {one.simulated:<12.6g} {one.exact:<12.6g} {verdict}{control}")
    return good


def tell_load_test(costs: Costs) -> None:
    """Shows the load test of BENCHMARKS.md (22 Nov 2026, slower tracker) beside its simulation."""
    print("\nnot a check: acknowledgement p50, p99, s       simulated    measured (older build)")
    measured = {1: (0.066, 0.216), 2: (0.131, 0.841), 4: (0.652, 10.558)}
    for robots, (p50, p99) in measured.items():
        load = {
            "robots.frames_per_second": 3.0,
            "robots.moving_share": 1.0,
            "robots.session_seconds": 1e9,
            "robots.questions_per_second": 5.0 / robots,
        }
        run = Young(costs.changed(load), Scenario(robots, 1, 1, 20.0)).run()
        name = f"{robots} robots, 3 frames/s, 5 questions/s, 20 s"
        print(f"{name:46} {run.p50:.3f}, {run.p99:.3f} {p50:.3f}, {p99:.3f}")
