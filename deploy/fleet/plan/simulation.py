"""One run of a fleet, and what is measured in it."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass

from checkpoints import Checkpoints
from costs import Costs
from events import Events, Processors
from failures import Failures
from maps import active_share, mean
from nats import Nats, Traffic, checkpoint_commits, frame_commits
from robots import Robots
from workers import Mapping

# Share of a run before anything is measured.
WARM_UP = 0.2


@dataclass(frozen=True, slots=True)
class Scenario:
    """What one run simulates."""

    robots: int
    workers: int
    gateways: int
    seconds: float
    seed: int = 1
    # Time between two deaths of workers; 0: none.
    death_seconds: float = 0.0


class Simulation:
    """Everything in a fleet. `run` lets it work."""

    def __init__(self, costs: Costs, scenario: Scenario) -> None:
        self.costs, self.scenario = costs, scenario
        self.events = Events(f"{scenario.seed} {scenario.robots}")
        self.nats = Nats(costs, scenario.robots * active_share(costs))
        self.gateways = [Processors(costs.gateway.cores) for _ in range(scenario.gateways)]
        self.mapping = Mapping(costs, self.events, scenario.workers)
        self.checkpoints = Checkpoints(self)
        self.failures = Failures(self)
        self.robots = Robots(self)
        self.measured = Measured(self)

    def run(self) -> "Measured":
        self.begin()
        self.events.run(self.scenario.seconds)
        self.measured.end()
        return self.measured

    def begin(self) -> None:
        self.robots.begin()
        warm = WARM_UP * self.scenario.seconds
        self.events.at(warm, self.measured.on_warm)
        if self.scenario.death_seconds:
            self.events.at(warm, self.failures.on_death)


def quantile(ordered: Sequence[float], share: float) -> float:
    if not ordered:
        return math.nan
    return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)]


class Measured:
    """What is measured from `on_warm` on: rates per second, and shares of what there is."""

    def __init__(self, run: Simulation) -> None:
        self.run, self.costs = run, run.costs
        self.before: dict[str, float] = {}
        self.latencies: Sequence[float] = array("d")
        self.memory_share = self.replay_seconds = 0.0

    def on_warm(self, _: None) -> None:
        self.before = self.totals()
        self.on_moment(None)

    def totals(self) -> dict[str, float]:
        """What only grows."""
        nats, now = self.run.nats, self.run.events.now
        nats.pool.advance(now)
        devices = [worker.device for worker in self.run.mapping.workers]
        return {
            "time": now,
            "frames": nats.frames,
            "stored bytes": nats.stored_bytes,
            "checkpoint bytes": nats.pool.written,
            "syncs": nats.syncs(),
            "gateways": sum(gateway.busy for gateway in self.run.gateways),
            "devices": sum(device.busy for device in devices),
            "behind": sum(device.behind for device in devices),
            "earned": sum(device.earned for device in devices),
            "done": sum(device.done for device in devices),
        }

    def on_moment(self, _: None) -> None:
        """Looks at the maps, a hundred times."""
        run, workers = self.run, self.run.mapping.workers
        self.memory_share = max(self.memory_share, *(one.memory_share() for one in workers))
        to_replay = [of.logged - of.saved for worker in workers for of in worker.maps if of.live]
        self.replay_seconds = mean(to_replay) * run.robots.interval
        wait = (1 - WARM_UP) * run.scenario.seconds / 100
        run.events.at(run.events.now + wait, self.on_moment)

    def add_latency(self, latency: float) -> None:
        if self.before:
            self.latencies.append(latency)

    def end(self) -> None:
        after, costs, scenario = self.totals(), self.costs, self.run.scenario
        delta = {name: after[name] - self.before.get(name, 0) for name in after}
        seconds = delta["time"]
        self.latencies = sorted(self.latencies)
        self.p50, self.p99 = quantile(self.latencies, 0.5), quantile(self.latencies, 0.99)
        self.stored_bytes = delta["stored bytes"]
        self.frame_rate = delta["frames"] / seconds
        self.checkpoint_rate = delta["checkpoint bytes"] / seconds
        self.syncs = delta["syncs"] / seconds
        self.gateway_share = delta["gateways"] / seconds / costs.gateway.cores / scenario.gateways
        self.device_share = delta["devices"] / seconds / scenario.workers
        self.behind_share = delta["behind"] / seconds / scenario.workers
        earned = delta["earned"]
        self.optimiser_share = min(1.0, delta["done"] / earned) if earned else 1.0

    def fits(self) -> bool:
        """Whether the fleet does what is asked for."""
        target = self.costs.target
        return (
            self.p99 < target.p99_seconds
            and self.memory_share <= 1
            and self.optimiser_share >= target.optimiser_share
        )

    def traffic(self) -> Traffic:
        frames = self.frame_rate * self.costs.robots.frame_bytes
        return Traffic(self.costs.nats, frames, self.checkpoint_rate)

    def limits(self) -> dict[str, float]:
        """Used shares of what does not become more with more workers and gateways."""
        nats, moved = self.costs.nats, self.traffic()
        written = moved.into * (nats.replicas / nats.nodes) * nats.writes_per_byte
        return {
            "commits of frames": self.frame_rate / frame_commits(self.costs),
            "commits of checkpoints": self.checkpoint_rate / checkpoint_commits(self.costs),
            "bytes to disk": written / nats.disk_bytes_per_second,
            "fsyncs of the disk": self.syncs / nats.syncs_per_second,
            "network into a node": max(moved.nodes_in) / nats.network_bytes_per_second,
            "network out of a node": max(moved.nodes_out) / nats.network_bytes_per_second,
        }
