"""Answers and statuses, as numpy arrays and plain objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from lexsplat._geometry import Array, rotation, vector_of
from lexsplat.v1 import lexsplat_pb2 as v1

Floats: TypeAlias = npt.NDArray[np.float32]
Bytes: TypeAlias = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Box:
    """A box in an image, pixels: its top-left corner, size, and the relevancy of its best pixel."""

    x: float
    y: float
    width: float
    height: float
    score: float


@dataclass(frozen=True)
class Peak:
    """The most relevant pixel of an image."""

    x: float
    y: float
    score: float


@dataclass(frozen=True, eq=False)
class Object:
    """Something in 3D, metres in the map's world.

    Attributes:
        score: Its relevancy, 0 to 1.
        confidence: That it is what was asked for, 0 to 1.
        center: Centre of the oriented box.
        size: Sides of the oriented box.
        rotation: 3x3 world_from_box of the oriented box.
        aabb_min: Smallest corner of the axis-aligned box.
        aabb_max: Largest corner.
        points: Number of points.
        distance: From `near` to the oriented box, 0 inside; None without `near`.
    """

    score: float
    confidence: float
    center: Array
    size: Array
    rotation: Array
    aabb_min: Array
    aabb_max: Array
    points: int
    distance: float | None

    @classmethod
    def _of(cls, wire: v1.Object) -> Object:
        return cls(
            wire.score,
            wire.confidence,
            vector_of(wire.center_metres),
            vector_of(wire.size_metres),
            rotation(wire.rotation),
            vector_of(wire.aabb_min_metres),
            vector_of(wire.aabb_max_metres),
            wire.points,
            wire.distance_metres if wire.HasField("distance_metres") else None,
        )


@dataclass(frozen=True)
class Understood:
    """How a text was understood: the parts that are decided one by one.

    Attributes:
        object: The kind of thing: "chair".
        attributes: What it looks like: "red", "not big".
        relation: Where it is, without the other thing: "next to"; empty if the text does not say.
        others: The other thing, as a text that asks for it; two for "between".
    """

    object: str
    attributes: list[str]
    relation: str
    others: list[str]

    @classmethod
    def _of(cls, wire: v1.Understood) -> Understood:
        return cls(wire.object, list(wire.attributes), wire.relation, list(wire.others))


@dataclass(frozen=True, eq=False)
class Answer:
    """Where something is.

    Attributes:
        text: What was asked for, as it was sent.
        understood: How the text was understood.
        present: Whether the map shows it.
        reason: Why not, where a color, a size or a place decided that; empty otherwise.
        confidence: How likely it is there, 0 to 1; `present` says whether that is one half or more.
        coverage: Share of the view or map that has language. If low, absent only means not seen.
        threshold: Relevancy above which something counts as found.
        heatmap: Relevancy of each pixel, (height, width), 0 to 1; None without a view.
        uncertainty: Probability that a pixel is in the mask and should not be, or vice versa,
            (height, width), 0 to 1; 0 where nothing was seen (see `coverage`) and where a color, a
            size or a place excludes it; None without a view.
        mask: Pixels above the threshold, (height, width), bool; None without a view.
        boxes: One for each connected region of the mask, best first.
        peak: The most relevant pixel; None without a view.
        points: Positions of what was found, (count, 3), metres in the world; None with a view.
        scores: Relevancy of each of the points, (count,); None with a view.
        objects: Best first, or nearest first with `near`; empty with a view.
        revision: Of the map.
        through: The newest frame that the map had; None before the first.
        settled: Whether the map had done its work on all frames. If not, the answer may change.
        converged: Whether the map had also been refined.
    """

    text: str
    understood: Understood
    present: bool
    reason: str
    confidence: float
    coverage: float
    threshold: float
    heatmap: Floats | None
    uncertainty: Floats | None
    mask: npt.NDArray[np.bool_] | None
    boxes: list[Box]
    peak: Peak | None
    points: Floats | None
    scores: Floats | None
    objects: list[Object]
    revision: int
    through: int | None
    settled: bool
    converged: bool

    @classmethod
    def _of(cls, wire: v1.QueryResponse) -> Answer:
        rows = _rows(wire.points.rows) if wire.HasField("points") else None
        return cls(
            text=wire.text,
            understood=Understood._of(wire.understood),
            present=wire.present,
            reason=wire.reason,
            confidence=wire.confidence,
            coverage=wire.coverage,
            threshold=wire.threshold,
            heatmap=_heatmap(wire.heatmap) if wire.HasField("heatmap") else None,
            uncertainty=_heatmap(wire.uncertainty) if wire.HasField("uncertainty") else None,
            mask=_mask(wire.mask) if wire.HasField("mask") else None,
            boxes=[Box(b.x, b.y, b.width, b.height, b.score) for b in wire.boxes],
            peak=_peak(wire.peak) if wire.HasField("peak") else None,
            points=None if rows is None else rows[:, :3],
            scores=None if rows is None else rows[:, 3],
            objects=[Object._of(found) for found in wire.objects],
            **_of_map(wire),
        )


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Which of several texts fits where. Label 0 is none of them, label k the k-th text.

    Attributes:
        texts: The texts.
        shares: Share of all pixels, or Gaussians, with each text, 0 to 1.
        image: Label of each pixel, (height, width), uint8; None without a view.
        points: Positions of all Gaussians with language, (count, 3), metres; None with a view.
        scores: Relevancy of each point's text, (count,); None with a view.
        labels: Label of each point, (count,), uint8; None with a view.
        revision: Of the map.
        through: The newest frame that the map had; None before the first.
        settled: Whether the map had done its work on all frames.
        converged: Whether the map had also been refined.
    """

    texts: list[str]
    shares: list[float]
    image: Bytes | None
    points: Floats | None
    scores: Floats | None
    labels: Bytes | None
    revision: int
    through: int | None
    settled: bool
    converged: bool

    @classmethod
    def _of(cls, wire: v1.QueryResponse) -> Segmentation:
        found = wire.segmentation
        rows = _rows(found.points.rows) if found.HasField("points") else None
        image = found.image if found.HasField("image") else None
        return cls(
            texts=[entry.text for entry in found.legend],
            shares=[entry.share for entry in found.legend],
            image=None if image is None else _bytes(image.labels).reshape(image.height, -1),
            points=None if rows is None else rows[:, :3],
            scores=None if rows is None else rows[:, 3],
            labels=None if rows is None else _bytes(found.points.labels),
            **_of_map(wire),
        )


@dataclass(frozen=True, eq=False)
class Up:
    """The direction up in a map.

    Attributes:
        direction: In the map's world, of unit length, (3,).
        source: "given" (the stream's `up`), "gravity" (the frames' `up`), "floor" (level and
            upright surfaces) or "camera" (a guess).
        confidence: How much speaks for it, 0 to 1.
    """

    direction: Array
    source: str
    confidence: float

    @classmethod
    def _of(cls, wire: v1.MapUp) -> Up:
        return cls(vector_of(wire.direction), wire.source, wire.confidence)


@dataclass(frozen=True)
class MapStatus:
    """A map.

    Attributes:
        name: Its name.
        revision: Increases each time queries get a newer map.
        frames_received: Frames that passed the checks.
        frames_tracked: Frames with a pose.
        frames_lost: Frames without a pose.
        frames_refused: Frames that did not pass the checks.
        frames_dropped: Frames accepted but never mapped.
        keyframes: Frames whose images the map keeps.
        gaussians: Gaussians of the map.
        tracking_state: "empty", "tracking" or "lost".
        queue_depth: Frames that wait to be mapped.
        settled: Whether the map has done its work on all frames.
        refinement: "waiting", "refining", "converged", or "off" if it is never done.
        failure: Why the map takes no more frames; empty if it does.
        recording_damage: What is wrong with the map's recording; empty if nothing is.
        input_warnings: What is probably wrong with the frames that were sent.
        loading: (frames done, frames in all) while the map is loaded after a start of the server,
            when all numbers above are 0; None otherwise.
        up: The direction up; None while the map is empty.
    """

    name: str
    revision: int
    frames_received: int
    frames_tracked: int
    frames_lost: int
    frames_refused: int
    frames_dropped: int
    keyframes: int
    gaussians: int
    tracking_state: str
    queue_depth: int
    settled: bool
    refinement: str
    failure: str
    recording_damage: str
    input_warnings: list[str]
    loading: tuple[int, int] | None
    up: Up | None

    @classmethod
    def _of(cls, wire: v1.MapStatus) -> MapStatus:
        own = {"input_warnings", "loading", "up"}
        same = {name: getattr(wire, name) for name in cls.__dataclass_fields__ if name not in own}
        loading = (wire.loading.frames_done, wire.loading.frames_total)
        return cls(
            **same,
            input_warnings=[warning.message for warning in wire.input_warnings],
            loading=loading if wire.HasField("loading") else None,
            up=Up._of(wire.up) if wire.HasField("up") else None,
        )


def _of_map(wire: v1.QueryResponse) -> dict[str, Any]:
    through = wire.through if wire.HasField("through") else None
    return {
        "revision": wire.revision,
        "through": through,
        "settled": wire.settled,
        "converged": wire.converged,
    }


def _floats(values: Any) -> Floats:
    # Twice as fast as numpy.array.
    return np.fromiter(values, np.float32, len(values))


def _rows(values: Any) -> Floats:
    return _floats(values).reshape(-1, 4)


def _bytes(data: bytes) -> Bytes:
    return np.frombuffer(data, dtype=np.uint8)


def _heatmap(wire: v1.Heatmap) -> Floats:
    return _floats(wire.values).reshape(wire.height, wire.width)


def _mask(wire: v1.Mask) -> npt.NDArray[np.bool_]:
    counts = np.array(wire.counts, dtype=np.int64)
    is_set = np.arange(len(counts)) % 2 == 1
    return np.repeat(is_set, counts).reshape((wire.height, wire.width), order="F")


def _peak(wire: v1.Peak) -> Peak:
    return Peak(wire.x, wire.y, wire.score)
