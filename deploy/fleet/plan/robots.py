"""Robots: their sessions, and the way of a frame through a gateway and the log to its worker."""

from typing import TYPE_CHECKING

from maps import Map, active_share, keyframes_seen

if TYPE_CHECKING:
    from simulation import Simulation


class Robots:
    def __init__(self, run: "Simulation") -> None:
        self.run, self.events, self.costs = run, run.events, run.costs
        robots = run.costs.robots
        self.interval = 1 / robots.frames_per_second
        self.uplink = robots.uplink_seconds + robots.frame_bytes / robots.uplink_bytes_per_second
        self.hop = run.costs.to_be_replaced.round_trip_seconds / 2
        self.lease_period = run.costs.failure.lease_seconds / 3

    # -- Sessions --

    def begin(self) -> None:
        """Robots as they are found at any time: pausing, or at some age of their sessions."""
        robots, exponential = self.costs.robots, self.events.exponential
        for robot in range(self.run.scenario.robots):
            if self.events.random.random() < active_share(self.costs):
                self.new_map(robot, exponential(robots.session_seconds))
            else:
                self.events.at(exponential(robots.pause_seconds), self.on_session, robot)

    def on_session(self, robot: int) -> None:
        self.new_map(robot, 0.0)

    def new_map(self, robot: int, age: float) -> None:
        """A session begins, or is found when it is `age` old."""
        robots, events, chance = self.costs.robots, self.events, self.events.random
        seen = int(keyframes_seen(self.costs, age))
        phase = chance.uniform(0, robots.cycle_seconds)
        new = Map(self.costs, robot, phase, min(seen, robots.max_keyframes))
        new.logged = int(age * robots.frames_per_second)
        mapping = self.run.mapping
        # At the start all workers live, and maps are spread evenly.
        at_start = mapping.workers[robot % len(mapping.workers)]
        (at_start if events.now == 0 else mapping.least_loaded()).own(new)
        self.run.checkpoints.begin(new, age)
        events.at(events.now + chance.random() * self.interval, self.on_frame, new)
        events.at(events.now + events.exponential(robots.session_seconds), self.on_end, new)
        events.at(events.now + chance.random() * self.lease_period, self.on_lease, new)
        if robots.questions_per_second:
            events.at(events.now + self.question_wait(), self.on_question, new)

    def on_end(self, of: Map) -> None:
        """A session ends. Its map leaves its worker."""
        of.ended = True
        self.run.failures.forget(of)
        if of.worker:
            of.worker.maps.pop(of, None)
        pause = self.events.exponential(self.costs.robots.pause_seconds)
        self.events.at(self.events.now + pause, self.on_session, of.robot)

    def on_lease(self, of: Map) -> None:
        """A worker renews its lease of a map."""
        if of.ended:
            return
        if of.live:
            self.run.nats.leases.commit(self.events.now)
        self.events.at(self.events.now + self.lease_period, self.on_lease, of)

    def question_wait(self) -> float:
        return self.events.exponential(1 / self.costs.robots.questions_per_second)

    def on_question(self, of: Map) -> None:
        if of.ended:
            return
        if of.live:
            of.worker.device.run(self.events.now, of.question)
        self.events.at(self.events.now + self.question_wait(), self.on_question, of)

    # -- A frame --

    def on_frame(self, of: Map) -> None:
        """A frame has arrived at its gateway."""
        if of.ended:
            return
        now, gateways = self.events.now, self.run.gateways
        gateway = gateways[of.robot % len(gateways)]
        checked = gateway.run(now, self.costs.to_be_replaced.gateway_seconds_per_frame)
        self.events.at(checked + self.hop, self.on_publish, (of, now - self.uplink))
        poisson = self.costs.robots.arrivals == "poisson"
        wait = self.events.exponential(self.interval) if poisson else self.interval
        self.events.at(now + wait, self.on_frame, of)

    def on_publish(self, frame: tuple[Map, float]) -> None:
        """A frame has arrived at the log's leader: it is written, synced, and sent on."""
        done = self.run.nats.publish(self.events.now, frame[0].robot)
        # A round trip to the other nodes, and the way to the worker.
        self.events.at(done + 3 * self.hop, self.on_deliver, frame)

    def on_deliver(self, frame: tuple[Map, float]) -> None:
        """A frame has arrived at its map's worker."""
        of, sent = frame
        of.logged += 1
        if of.live:
            self.map_frame(of, sent)
        elif not of.ended:
            of.waiting.append(sent)

    def map_frame(self, of: Map, sent: float) -> float:
        """Has a frame mapped; gives when its acknowledgement leaves the worker."""
        done = self.run.mapping.map_frame(of, sent)
        way = 2 * self.hop + self.costs.robots.uplink_seconds
        self.run.measured.add_latency(done + way - sent)
        return done
