"""Workers: devices that map frames, answer questions and run the optimiser. They never die here."""

from collections import deque

from costs import Costs
from events import Events
from maps import Map


class Device:
    """A worker's device. Frames go first; a step of the optimiser that has begun is finished."""

    def __init__(self, network_seconds: float) -> None:
        self.network_seconds = network_seconds
        # Seconds of work that does not wait, and of the rest; steps that were earned and taken.
        self.free = self.busy = self.behind = 0.0
        self.earned = self.done = 0
        # Keyframes that wait for the networks, and maps that owe steps and take turns.
        self.keyframes = 0
        self.turns: deque[Map] = deque()

    def run(self, now: float, seconds: float) -> float:
        """When work that does not wait for the optimiser is done."""
        if self.free < now:
            self.idle_until(now)
            self.free = max(self.free, now)
        self.free += seconds
        self.busy += seconds
        return self.free

    def idle_until(self, now: float) -> None:
        """Spends the time until now on what waits."""
        while self.free < now:
            if self.keyframes:
                self.keyframes -= 1
                self.free += self.network_seconds
                self.behind += self.network_seconds
            elif self.turns:
                of = self.turns.popleft()
                self.steps(of, 1)
                if of.owed:
                    self.turns.append(of)
            else:
                break

    def steps(self, of: Map, most: int) -> None:
        """Takes steps that a map owes."""
        taken = min(most, of.owed)
        of.owed -= taken
        self.done += taken
        self.free += taken * of.step
        self.behind += taken * of.step

    def owe(self, of: Map, steps: int) -> None:
        """A keyframe has come: it waits for the networks and owes steps."""
        self.keyframes += 1
        self.earned += steps
        of.owed += steps
        self.queue(of)

    def queue(self, of: Map) -> None:
        if of not in self.turns:
            self.turns.append(of)


class Worker:
    """A device, and the maps whose leases it holds."""

    def __init__(self, costs: Costs) -> None:
        self.costs = costs
        self.alive = True
        self.loading = 0.0
        self.start()

    def start(self) -> None:
        self.device = Device(self.costs.worker.language_seconds_per_keyframe)
        # An ordered set, so that runs repeat.
        self.maps: dict[Map, None] = {}
        # Frames that may not be acknowledged yet: when they will be, map, time of sending.
        self.recent: deque[tuple[float, Map, float]] = deque()

    def own(self, of: Map) -> None:
        of.worker = self
        self.maps[of] = None

    def memory_share(self) -> float:
        """The used share of memory, of device and host the larger one."""
        worker = self.costs.worker
        keyframes = sum(of.keyframes for of in self.maps)
        gaussians = sum(of.gaussians for of in self.maps)
        device = (
            worker.base_bytes
            + keyframes * worker.bytes_per_keyframe
            + gaussians * worker.bytes_per_gaussian
        )
        on_host = keyframes * worker.host_bytes_per_keyframe / worker.host_bytes
        return max(device / worker.memory_bytes, on_host)


class Mapping:
    """All workers, and what they do with a frame."""

    def __init__(self, costs: Costs, events: Events, workers: int) -> None:
        self.costs, self.events = costs, events
        self.workers = [Worker(costs) for _ in range(workers)]
        robots = costs.robots
        self.moving_seconds = robots.moving_share * robots.cycle_seconds
        self.keyframe_chance = robots.keyframes_per_moving_second * (1 / robots.frames_per_second)

    def least_loaded(self) -> Worker:
        """The living worker with the fewest maps."""
        alive = (worker for worker in self.workers if worker.alive)
        return min(alive, key=lambda worker: len(worker.maps))

    def map_frame(self, of: Map, sent: float) -> float:
        """When the worker acknowledges a frame."""
        moving = (sent + of.phase) % self.costs.robots.cycle_seconds < self.moving_seconds
        keyframe = moving and self.events.random.random() < self.keyframe_chance
        done = self.track(of, keyframe)
        if keyframe:
            of.add_keyframe(self.costs)
            self.owe(of)
        recent, now = of.worker.recent, self.events.now
        while recent and recent[0][0] < now:
            recent.popleft()
        recent.append((done, of, sent))
        return done

    def replay(self, of: Map) -> float:
        """When a frame that was acknowledged before is mapped again."""
        chance = self.keyframe_chance * self.costs.robots.moving_share
        keyframe = self.events.random.random() < chance
        done = self.track(of, keyframe)
        if keyframe:
            self.owe(of)
        return done

    def track(self, of: Map, keyframe: bool) -> float:
        worker, device = self.costs.worker, of.worker.device
        insert = of.insert if keyframe else 0.0
        done = device.run(self.events.now, worker.track_seconds + insert)
        if of.live or self.costs.failure.steps_while_replaying:
            device.steps(of, worker.steps_per_frame)
        return done

    def owe(self, of: Map) -> None:
        of.worker.device.owe(of, self.costs.worker.steps_per_keyframe)
