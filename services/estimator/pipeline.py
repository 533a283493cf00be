"""What the estimator asks of a sensor's pipeline: VT&R3's five stages, in vehicle frames.

A pipeline preprocesses a frame and measures its motion (:meth:`Pipeline.process`), maps it (:meth:`Pipeline.keyframe`,
:meth:`Pipeline.join`), decides on vertices (:meth:`Pipeline.is_vertex_due`) and localizes (:meth:`Pipeline.localize`,
:meth:`Pipeline.search`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array, Uncertain
from common.messages import Keyframe, VertexRecord

Live = TypeVar("Live")
Live_contra = TypeVar("Live_contra", contravariant=True)
Submap = TypeVar("Submap")


@dataclass(frozen=True, slots=True)
class Step(Generic[Live]):
    """A processed frame.

    Attributes:
        stamp: of the frame, nanoseconds.
        T_last_live: the vehicle's motion since the frame before, with covariance.
        keyframe: number of the odometry's keyframe that this frame was measured against.
        T_keyframe_live: the vehicle's motion since then, with covariance.
        T_previous_keyframe: the vehicle's motion from the keyframe before to that one, where it is known better by now
            than from the frames between.
        twist: (6,) m/s and rad/s in the vehicle frame.
        success: whether the motion was measured; if not it is only predicted.
        inliers: measurements that agree on it.
        reason: why it was not measured.
        live: what mapping and localization need of the frame.
        milliseconds: time spent by stage.
    """

    stamp: int
    T_last_live: Uncertain
    keyframe: int
    T_keyframe_live: Uncertain
    twist: Array
    success: bool
    inliers: int
    reason: str
    live: Live
    milliseconds: dict[str, float] = field(default_factory=dict)
    T_previous_keyframe: Uncertain | None = None


@dataclass(frozen=True, slots=True)
class StreamResult:
    """What one stream made of a frame: whether it localized, how many landmarks agree, and why it failed."""

    success: bool
    inliers: int
    reason: str


@dataclass(frozen=True, slots=True)
class Localized:
    """The outcome of a localization against a submap.

    Attributes:
        success: whether it counts.
        T_vertex_live: the vehicle in the vertex's frame, with covariance; the prior where it failed.
        inliers: landmarks that agree.
        stream: name of the stream that localized.
        reason: why it failed.
        streams: what each stream made of it, by name.
        members: landmarks that agree by member of a joint submap, in the order in which they were joined.
        pixels: x, y (N, 2) in the frame's image, or scan, of the landmarks that agree; None where it is of neither.
    """

    success: bool
    T_vertex_live: Uncertain
    inliers: int
    stream: str
    reason: str
    streams: Mapping[str, StreamResult] = field(default_factory=dict)
    members: tuple[int, ...] = ()
    pixels: NDArray[np.floating[Any]] | None = None


class Pipeline(Protocol[Live_contra, Submap]):
    """One sensor's way through the five stages."""

    def keyframe(self, live: Live_contra) -> Keyframe:
        """The local map of a frame, to be stored in its vertex."""
        ...

    def read(self, record: VertexRecord) -> Submap:
        """The submap of a stored vertex; ValueError where it is none of this pipeline's."""
        ...

    def join(self, members: Sequence[tuple[Submap, Uncertain]]) -> Submap:
        """One submap of several, each with its vertex's pose ``T_first_vertex`` in the first one's frame."""
        ...

    def is_vertex_due(self, T_vertex_live: Array, inliers: int) -> bool:
        """Whether the live frame is to become a vertex."""
        ...

    def localize(self, submap: Submap, prior: Uncertain, live: Live_contra) -> Localized:
        """Localizes with a prior ``T_vertex_live``."""
        ...

    def search(self, submap: Submap, live: Live_contra) -> Localized:
        """Localizes a vehicle that is assumed within a metre or so of the vertex."""
        ...
