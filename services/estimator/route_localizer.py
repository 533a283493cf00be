"""Localization along a route: the chain's prior, the trunk's submap, and the search where there is no prior."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from common.geometry import Array, Uncertain
from common.ids import VertexId
from services.estimator.chain import ChainSettings, LocalizationChain
from services.estimator.pipeline import Localized, Pipeline, Step

Live = TypeVar("Live")
Submap = TypeVar("Submap")


@dataclass(frozen=True, slots=True)
class WindowSettings:
    """Which submaps are fetched, and which are searched when the robot must find itself.

    Attributes:
        fetch_ahead, fetch_behind: metres of the route whose submaps are kept at hand.
        search: metres before and after the target that are searched.
        searches: submaps tried on each frame of a search.
    """

    fetch_ahead: float = 8.0
    fetch_behind: float = 3.0
    search: float = 2.0
    searches: int = 1


class RouteLocalizer(Generic[Live, Submap]):
    """Keeps the live robot located on a route of vertices with poses ``T_first_vertex`` (N, 4, 4)."""

    def __init__(
        self,
        vertices: Sequence[VertexId],
        path: Array,
        pipeline: Pipeline[Live, Submap],
        submap: Callable[[VertexId], Submap | None],
        chain: ChainSettings,
        window: WindowSettings,
    ) -> None:
        self.vertices = list(vertices)
        self.chain = LocalizationChain(path, chain)
        self._pipeline = pipeline
        self._submap = submap
        self._window = window
        self._candidates: itertools.cycle[int] = itertools.cycle([0])

    @property
    def trunk(self) -> VertexId:
        """The vertex that the robot is nearest to."""
        return self.vertices[self.chain.trunk]

    def trunk_and_leaf(self) -> tuple[VertexId, Uncertain]:
        """The trunk, and the live robot in its frame."""
        return self.trunk, self.chain.T_trunk_leaf()

    def start(self, target: VertexId | None) -> None:
        """Expects the robot at a vertex of the route, or at its first."""
        index = self.vertices.index(target) if target in self.vertices else 0
        self.chain.start(index)
        around = self.chain.window(self._window.search, self._window.search)
        self._candidates = itertools.cycle(sorted(around, key=lambda i: abs(i - index)))

    def wanted(self) -> list[VertexId]:
        """Vertices whose submaps are or will soon be needed, nearest first."""
        around = self.chain.window(self._window.fetch_behind, self._window.fetch_ahead)
        return [self.vertices[i] for i in sorted(around, key=lambda i: abs(i - self.chain.trunk))]

    def move(self, step: Step[Live]) -> None:
        """Takes a frame's odometry along without localizing."""
        self.chain.move(step.T_last_live)

    def follow(self, step: Step[Live]) -> Localized:
        """Localizes a frame, whose odometry was taken, against the trunk by the chain's prior."""
        prior = self.chain.T_trunk_leaf()
        submap = self._submap(self.trunk)
        if submap is None:
            return Localized(
                success=False,
                T_vertex_live=prior,
                inliers=0,
                stream="none",
                reason="the trunk's submap is not here yet",
            )
        result = self._pipeline.localize(submap, prior, step.live)
        if result.success:
            self.chain.localize(result.T_vertex_live)
        return result

    def search(self, step: Step[Live]) -> Localized:
        """Looks for a robot whose place is not known by odometry, around the vertex that it was started at."""
        if self.chain.localized:
            result = self.follow(step)
            if result.success:
                return result
        result = self._missing()
        for index in itertools.islice(self._candidates, self._window.searches):
            submap = self._submap(self.vertices[index])
            if submap is None:
                continue
            result = self._pipeline.search(submap, step.live)
            if result.success:
                self.chain.start(index)
                self.chain.localize(result.T_vertex_live)
                return result
        return result

    def _missing(self) -> Localized:
        prior = self.chain.T_trunk_leaf()
        return Localized(
            success=False,
            T_vertex_live=prior,
            inliers=0,
            stream="none",
            reason="no submap is here yet to localize against",
        )


def single_vertex_path() -> Array:
    """The path of a route that consists of its target alone."""
    return Uncertain.identity().T[None]
