"""The submaps along a route: each vertex's own, joined with those of the experiences that are worth it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain
from common.ids import VertexId
from services.estimator.experiences import ExperienceChoice, ExperienceSettings, RouteExperiences
from services.estimator.pipeline import Localized, Pipeline

Live = TypeVar("Live")
Submap = TypeVar("Submap")


@dataclass(frozen=True, slots=True)
class JointSubmap(Generic[Submap]):
    """A submap in the frame of the first of the vertices that it was joined of."""

    submap: Submap
    members: tuple[VertexId, ...]


class RouteMap(Generic[Live, Submap]):
    """What there is to localize against along a route of N vertices with poses ``path`` (N, 4, 4) in the first's frame.

    ``submap`` gives a vertex's submap where it is at hand. Work and memory are bounded by the settings, whatever the
    number of experiences. It belongs to one thread, but for :meth:`use`.
    """

    def __init__(
        self,
        vertices: Sequence[VertexId],
        path: Array,
        pipeline: Pipeline[Live, Submap],
        submap: Callable[[VertexId], Submap | None],
        settings: ExperienceSettings,
    ) -> None:
        self.vertices = list(vertices)
        self._path = np.asarray(path, dtype=np.float64)
        self._pipeline = pipeline
        self._submap = submap
        self._settings = settings
        self._known: tuple[RouteExperiences, ExperienceChoice] | None = None
        self._ranking: list[str] = []
        self._joint: JointSubmap[Submap] | None = None

    def extend(self, vertices: Sequence[VertexId], path: Array) -> None:
        """Goes on over a longer route that begins with the present vertices."""
        self.vertices = list(vertices)
        self._path = np.asarray(path, dtype=np.float64)

    def use(self, experiences: RouteExperiences) -> None:
        """Joins these experiences from now on; may be called from any thread."""
        self._known = experiences, ExperienceChoice(experiences.stamps, self._settings)

    def rank(self, now: int) -> None:
        """Ranks the experiences anew; ``now`` is the live frame's stamp, nanoseconds."""
        if self._known is not None:
            self._ranking = self._known[1].ranking(now)

    def own(self, index: int) -> Submap | None:
        """The submap of the route's own vertex at a place, where it is at hand."""
        return self._submap(self.vertices[index])

    def at(self, index: int) -> JointSubmap[Submap] | None:
        """The submap at a place of the route; None while the privileged vertex's own is not at hand."""
        own = self._submap(self.vertices[index])
        if own is None:
            return None
        parts = [(self.vertices[index], own, Uncertain.identity())]
        for vertex, T_trunk_vertex in itertools.chain(self._beside(index), self._chosen(index)):
            other = self._submap(vertex)
            if other is not None:
                parts.append((vertex, other, T_trunk_vertex))
        members = tuple(vertex for vertex, _, _ in parts)
        if self._joint is None or self._joint.members != members:
            self._joint = JointSubmap(self._pipeline.join([(submap, T) for _, submap, T in parts]), members)
        return self._joint

    def wanted(self, indices: Iterable[int]) -> list[VertexId]:
        """Vertices whose submaps are needed at places of the route, in the order of the places."""
        wish: list[VertexId] = []
        for index in indices:
            wish.append(self.vertices[index])
            wish.extend(vertex for vertex, _ in self._chosen(index))
        return list(dict.fromkeys(wish))

    def credit(self, joint: JointSubmap[Submap], result: Localized) -> None:
        """Remembers which members a localization owes its landmarks to."""
        if self._known is not None and result.success:
            counts: dict[str, int] = {}
            for vertex, count in zip(joint.members, result.members, strict=True):
                counts[vertex.map_id] = counts.get(vertex.map_id, 0) + count
            self._known[1].credit(counts)

    def _beside(self, index: int) -> Iterator[tuple[VertexId, Uncertain]]:
        """The route's vertices before and after one, with ``T_trunk_vertex``."""
        reach = self._settings.window
        for other in range(max(index - reach, 0), min(index + reach + 1, len(self.vertices))):
            if other != index:
                T = geometry.inverse(self._path[index]) @ self._path[other]
                rates = [self._settings.path_drift, self._settings.path_turn]
                sigma = np.repeat(rates, 3) * float(np.linalg.norm(T[:3, 3]))
                yield self.vertices[other], Uncertain(T, np.diag(sigma**2))

    def _chosen(self, index: int) -> list[tuple[VertexId, Uncertain]]:
        return [] if self._known is None else self._known[0].near(index, self._ranking)
