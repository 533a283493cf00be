"""The vertex that odometry is told from."""

from __future__ import annotations

from typing import Any

from common.geometry import Uncertain
from common.ids import VertexId
from services.estimator.experience import Place
from services.estimator.pipeline import Step
from services.estimator.reckoning import DeadReckoning


class Anchor:
    """A vertex, and the live frame in it by dead reckoning.

    Attributes:
        vertex: None until there was one; odometry then tells of the first frame's.
        joined: that vertex, where the robot was localized against it to begin a map there.
    """

    def __init__(self) -> None:
        self.vertex: VertexId | None = None
        self.joined: VertexId | None = None
        self._reckoning = DeadReckoning()

    @property
    def T_vertex_live(self) -> Uncertain:
        """The live frame in the vertex's, the identity where there is no vertex."""
        return Uncertain.identity() if self.vertex is None else self._reckoning.T_reference_live

    def move(self, step: Step[Any]) -> None:
        """Takes the live frame on by a frame's odometry."""
        self._reckoning.move(step)

    def set(self, place: Place | None) -> None:
        """Odometry is told from this vertex on; nothing changes where that is None."""
        if place is not None:
            self.vertex = place[0]
            self._reckoning.start(place[1])

    def forget(self) -> None:
        """There is no vertex, and the next frame is the first."""
        self.vertex = None
        self._reckoning = DeadReckoning()

    def joint(self) -> Place | None:
        """Where a new map is joined to another one, None where the robot has not been localized for that."""
        if self.vertex is None or self.vertex != self.joined:
            return None
        return self.vertex, self.T_vertex_live
