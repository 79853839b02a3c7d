"""Deaths of workers, and how other workers take their maps over."""

from typing import TYPE_CHECKING

from maps import Map
from workers import Worker

if TYPE_CHECKING:
    from simulation import Simulation

# Workers that die in the run that measures take-overs.
DEATHS = 20


class Failures:
    def __init__(self, run: "Simulation") -> None:
        self.run, self.events, self.costs = run, run.events, run.costs
        # Maps without a worker that can map their frames.
        self.homeless: dict[Map, None] = {}
        # Seconds of take-overs; deaths; frames that take-overs delayed for too long.
        self.takeovers: list[float] = []
        self.deaths = self.delayed = 0

    def on_death(self, _: None) -> None:
        """A worker with maps dies. After the last death the run ends with the last take-over."""
        if self.deaths == DEATHS:
            return
        alive = [worker for worker in self.run.mapping.workers if worker.alive]
        busy = [worker for worker in alive if worker.maps]
        if busy and len(alive) > 1:
            self.deaths += 1
            self.kill(self.events.random.choice(busy))
        self.events.at(self.events.now + self.run.scenario.death_seconds, self.on_death)

    def kill(self, worker: Worker) -> None:
        now, failure = self.events.now, self.costs.failure
        worker.alive = False
        renewed = self.events.random.random() * failure.lease_seconds / 3
        claim = now + failure.lease_seconds - renewed + self.costs.to_be_replaced.claim_seconds
        for of in worker.maps:
            of.turn += 1
            # A map that was catching up has been away for longer.
            of.died = now if of.live else of.died
            of.worker, of.live = None, False
            self.homeless[of] = None
            self.events.at(claim, self.on_claim, (of, of.turn))
        # Frames that were being mapped are not acknowledged. The next worker finds them in the log.
        for done, of, sent in reversed(worker.recent):
            if done > now and of in worker.maps:
                of.waiting.appendleft(sent)
        self.events.at(now + failure.restart_seconds, self.on_restart, worker)

    def on_restart(self, worker: Worker) -> None:
        worker.start()
        worker.alive, worker.loading = True, self.events.now

    def on_claim(self, plan: tuple[Map, int]) -> None:
        """The worker with the fewest maps takes a map, and loads its checkpoint."""
        of, turn = plan
        if of.ended or of.turn != turn:
            return
        worker = self.run.mapping.least_loaded()
        worker.own(of)
        speed = self.costs.to_be_replaced.load_bytes_per_second
        worker.loading = max(worker.loading, self.events.now) + of.saved_bytes / speed
        of.silent = of.logged - of.saved - len(of.waiting)
        worker.device.queue(of)
        self.events.at(worker.loading, self.on_replay, plan)

    def on_replay(self, plan: tuple[Map, int]) -> None:
        """Maps the next frame of the log; first come those that were acknowledged before."""
        of, turn = plan
        if of.ended or of.turn != turn:
            return
        if of.silent > 0:
            of.silent -= 1
            self.events.at(self.run.mapping.replay(of), self.on_replay, plan)
        elif of.waiting:
            sent = of.waiting.popleft()
            done = self.run.robots.map_frame(of, sent)
            self.delayed += done - sent > self.costs.target.p99_seconds
            self.events.at(done, self.on_replay, plan)
        else:
            self.taken_over(of)

    def taken_over(self, of: Map) -> None:
        of.live = True
        self.takeovers.append(self.events.now - of.died)
        self.forget(of)
        wait = self.costs.checkpoint.period_seconds * self.events.random.random()
        self.events.at(self.events.now + wait, self.run.checkpoints.on_begin, (of, of.turn))

    def forget(self, of: Map) -> None:
        self.homeless.pop(of, None)
        if self.deaths == DEATHS and not self.homeless:
            self.events.stopped = True

    def seconds_away(self) -> list[float]:
        """Times of take-overs, in order. Those that have not ended count up to now."""
        away = [self.events.now - of.died for of in self.homeless]
        return sorted([*self.takeovers, *away])
