"""What the operator has blocked, and where the robot is to drive slowly."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

from common.errors import GraphError
from common.ids import VertexId
from common.messages import Restriction

UNLIMITED = 1e3
"""Metres a second that no robot drives: where nothing is restricted."""


class Blocked(GraphError):
    """A route leads over a stretch that the operator has blocked."""


class Restrictions:
    """The restricted stretches of an environment's maps."""

    def __init__(self, restrictions: Iterable[Restriction]) -> None:
        self._of_map: dict[str, list[Restriction]] = {}
        for restriction in restrictions:
            self._of_map.setdefault(restriction.map, []).append(restriction)

    def speed(self, vertex: VertexId) -> float:
        """The speed that is allowed at a vertex, m/s: 0 where it is blocked, ``UNLIMITED`` where nothing is said."""
        found = self._of_map.get(vertex.map_id, ())
        speeds = (r.speed for r in found if r.speed is not None and r.first <= vertex.index <= r.last)
        return min(speeds, default=UNLIMITED)

    def blocked(self, vertex: VertexId) -> bool:
        """Whether a vertex must not be driven over."""
        return self.speed(vertex) == 0.0

    def blocked_maps(self) -> list[str]:
        """Maps that cannot be driven from one end to the other."""
        return [map_id for map_id, found in self._of_map.items() if any(r.speed == 0.0 for r in found)]

    def require_free(self, vertices: Sequence[VertexId]) -> None:
        """Refuses a route over a blocked vertex; the first one, where the robot stands, does not count.

        Raises:
            Blocked: it leads over one.
        """
        for vertex in vertices[1:]:
            if self.blocked(vertex):
                raise Blocked(f"the way leads over {vertex}, which is blocked{self._why(vertex)}")

    def speed_limits(self, vertices: Sequence[VertexId]) -> list[float]:
        """The speed (m/s) on the stretch from each vertex of a route to the next; empty where nothing is limited.

        A stretch that begins or ends in a restricted one is restricted. That a robot stands where it may not is no
        reason to hold it there.
        """
        at = [self.speed(vertex) or UNLIMITED for vertex in vertices]
        if min(at, default=UNLIMITED) >= UNLIMITED:
            return []
        return [min(pair) for pair in itertools.pairwise(at)] + at[-1:]

    def _why(self, vertex: VertexId) -> str:
        found = self._of_map[vertex.map_id]
        reason = next((r.reason for r in found if r.speed == 0.0 and r.first <= vertex.index <= r.last), "")
        return f" ({reason})" if reason else ""
