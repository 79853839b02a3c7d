"""NATS: the log of frames, leases, and the store of checkpoints; what they can take, and traffic.

Three healthy nodes. Node 0 leads the log, the last one leads the checkpoints.
"""

import math
from types import SimpleNamespace

from costs import Costs
from events import GroupCommit, Pool


def frames_in_batch(costs: Costs) -> int:
    """A batch is closed by the frame that makes it reach its size."""
    return max(1, math.ceil(costs.nats.batch_bytes / costs.robots.frame_bytes))


def frame_commits(costs: Costs) -> float:
    """Frames per second that the log can commit."""
    batches = costs.nats.frame_groups / costs.to_be_replaced.sync_seconds
    return batches * frames_in_batch(costs)


def checkpoint_commits(costs: Costs) -> float:
    """Bytes of checkpoints per second that the object store can commit."""
    batches = costs.nats.checkpoint_groups / costs.to_be_replaced.sync_seconds
    return batches * max(costs.nats.batch_bytes, costs.nats.chunk_bytes)


class Nats:
    """Frames are written in their order, then synced. Checkpoints get what frames leave."""

    def __init__(self, costs: Costs, robots: float) -> None:
        nats, sync = costs.nats, costs.to_be_replaced.sync_seconds
        self.log = [GroupCommit(sync, frames_in_batch(costs)) for _ in range(nats.frame_groups)]
        self.leases = GroupCommit(sync, math.inf)
        self.frames = self.stored_bytes = 0
        self.disk_free = 0.0
        self.frame_bytes, self.replicas = costs.robots.frame_bytes, nats.replicas
        self.disk_seconds = self.frame_bytes * nats.writes_per_byte / nats.disk_bytes_per_second
        # For checkpoints there is the least of commits, disk and network.
        frames = robots * costs.robots.frames_per_second * self.frame_bytes
        disk = nats.disk_bytes_per_second / nats.writes_per_byte - frames
        network = nats.network_bytes_per_second / max(1, nats.replicas - 1) - frames
        capacity = max(1e6, min(checkpoint_commits(costs), disk, network))
        most = costs.to_be_replaced.checkpoint_bytes_per_second
        self.pool = Pool(capacity, most, nats.chunk_bytes, nats.batch_bytes)

    def publish(self, now: float, robot: int) -> float:
        """When a frame that arrives at the log's leader now is on its disk."""
        self.frames += 1
        self.stored_bytes += self.frame_bytes * self.replicas
        self.disk_free = max(self.disk_free, now) + self.disk_seconds
        return self.log[robot % len(self.log)].commit(self.disk_free)

    def syncs(self) -> float:
        frames = sum(group.batches for group in self.log)
        return frames + self.leases.batches + self.pool.batches


class Traffic:
    """Bytes per second: from clients, between nodes, to workers; of each node.

    Clients are connected to any node, so most of their bytes pass through a second one. Frames are
    also delivered to workers; checkpoints are read only after a death.
    """

    def __init__(self, nats: SimpleNamespace, frames: float, checkpoints: float) -> None:
        copies, others = nats.replicas - 1, max(1, nats.nodes - 1)
        elsewhere = (nats.nodes - 1) / nats.nodes
        self.into, self.out = frames + checkpoints, frames
        self.between = frames * (copies + 2 * elsewhere) + checkpoints * (copies + elsewhere)
        # Per byte, into and out of a node that does not lead.
        frame_in, frame_out = copies / others + 2 / nats.nodes, 2 / nats.nodes
        write_in, write_out = copies / others + 1 / nats.nodes, 1 / nats.nodes
        self.nodes_in = [frames * frame_in + checkpoints * write_in] * nats.nodes
        self.nodes_out = [frames * frame_out + checkpoints * write_out] * nats.nodes
        self.nodes_in[0] += frames * (1 - frame_in)
        self.nodes_out[0] += frames * (copies + 1 - frame_out)
        self.nodes_in[-1] += checkpoints * (1 - write_in)
        self.nodes_out[-1] += checkpoints * (copies - write_out)
