"""What became of frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from lexsplat._geometry import Array, pose_of
from lexsplat.v1 import lexsplat_pb2 as v1

# Results that a summary keeps: a robot that drives all day has millions.
RESULTS_KEPT = 10_000

Status: TypeAlias = Literal["tracked", "relocalised", "lost", "refused", "received"]
_STATUSES: dict[v1.FrameStatus, Status] = {
    v1.FRAME_STATUS_TRACKED: "tracked",
    v1.FRAME_STATUS_RELOCALISED: "relocalised",
    v1.FRAME_STATUS_LOST: "lost",
    v1.FRAME_STATUS_REFUSED: "refused",
}


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What became of a frame.

    Attributes:
        sequence: Number of the frame.
        status: "tracked"; "relocalised": tracked again after frames were lost; "lost": without a
            pose, not used; "refused": it did not pass the checks; "received": in the map, but the
            connection broke before more was told.
        pose: 4x4 world_from_camera that the map uses, metres; None if there is none.
        covariance: 6x6 covariance of an estimated pose; None if the pose was given.
        keyframe: Whether the map keeps its images.
        refused_field: The field that did not pass a check; empty unless refused.
        refused_reason: Why.
        durable_through: Frames up to this one survive a crash of the server; None: none do.
        queue: How full the map's queue is, 0 to 1.
    """

    sequence: int
    status: Status
    pose: Array | None = None
    covariance: Array | None = None
    keyframe: bool = False
    refused_field: str = ""
    refused_reason: str = ""
    durable_through: int | None = None
    queue: float = 0.0

    @classmethod
    def _of(cls, ack: v1.FrameAck) -> FrameResult:
        covariance = np.array(ack.pose_covariance).reshape(6, 6) if ack.pose_covariance else None
        return cls(
            ack.sequence,
            _STATUSES.get(ack.status, "received"),
            pose_of(ack.world_from_camera) if ack.HasField("world_from_camera") else None,
            covariance,
            ack.keyframe,
            ack.refused_field,
            ack.refused_reason,
            ack.durable_through if ack.HasField("durable_through") else None,
            ack.queue_depth / max(ack.queue_capacity, 1),
        )


@dataclass
class Summary:
    """What became of a stream.

    Attributes:
        frames: Frames that were sent and answered.
        tracked: Of these, those with a pose.
        lost: Those without a pose.
        refusals: Those that did not pass the checks.
        keyframes: Those whose images the map keeps.
        skipped: Frames that were not sent, because the map had their sequence numbers already.
        results: What became of each frame, in order; of long streams, of the newest 10,000.
        refused: The same for frames that did not pass the checks, with field and reason.
    """

    frames: int = 0
    tracked: int = 0
    lost: int = 0
    refusals: int = 0
    keyframes: int = 0
    skipped: int = 0
    results: deque[FrameResult] = field(default_factory=lambda: deque(maxlen=RESULTS_KEPT))
    refused: deque[FrameResult] = field(default_factory=lambda: deque(maxlen=RESULTS_KEPT))

    def _count(self, result: FrameResult) -> None:
        self.frames += 1
        self.tracked += result.status in ("tracked", "relocalised")
        self.lost += result.status == "lost"
        self.keyframes += result.keyframe
        self.results.append(result)
        if result.status == "refused":
            self.refusals += 1
            self.refused.append(result)

    def __str__(self) -> str:
        text = f"{self.frames} frames: {self.tracked} tracked, {self.lost} lost"
        text += f", {self.refusals} refused, {self.keyframes} keyframes"
        return text + (f"; {self.skipped} were in the map already" if self.skipped else "")


OnFrame: TypeAlias = Callable[[FrameResult], object]
