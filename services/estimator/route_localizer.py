"""Localization along a route: the chain's prior, the trunk's submap, and the search where there is no prior."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, TypeVar

from common.geometry import Array, Uncertain, covariance_intersection
from common.ids import VertexId
from services.estimator.chain import ChainSettings, LocalizationChain
from services.estimator.experiences import RouteExperiences
from services.estimator.pipeline import Localized, Pipeline, Step
from services.estimator.route_map import RouteMap

Live = TypeVar("Live")
Submap = TypeVar("Submap")


@dataclass(frozen=True, slots=True)
class WindowSettings:
    """Which submaps are fetched, and which are searched when the robot must find itself.

    Attributes:
        fetch_ahead, fetch_behind: metres of the route whose submaps are kept at hand.
        search: metres before and after the target that are searched.
        searches: submaps tried on each frame of a search, beside the one where the robot is assumed to be.
    """

    fetch_ahead: float = 8.0
    fetch_behind: float = 3.0
    search: float = 2.0
    searches: int = 1


class RouteLocalizer(Generic[Live, Submap]):
    """Keeps the live robot located on a route with poses ``T_first_vertex`` (N, 4, 4) of its N vertices.

    Attributes:
        metric: whether every coordinate of the robot's pose is measured.
    """

    metric: ClassVar[bool] = True

    def __init__(
        self,
        route_map: RouteMap[Live, Submap],
        path: Array,
        pipeline: Pipeline[Live, Submap],
        chain: ChainSettings,
        window: WindowSettings,
    ) -> None:
        self.map = route_map
        self.chain = LocalizationChain(path, chain)
        self._pipeline = pipeline
        self._window = window
        self._candidates: itertools.cycle[int] = itertools.cycle([0])
        self._wanted: tuple[int, list[VertexId]] | None = None

    @property
    def trunk(self) -> VertexId:
        """The vertex that the robot is nearest to."""
        return self.map.vertices[self.chain.trunk]

    def trunk_and_leaf(self) -> tuple[VertexId, Uncertain]:
        """The trunk, and the live robot in its frame."""
        return self.trunk, self.chain.T_trunk_leaf()

    def branch_and_leaf(self) -> tuple[VertexId, Uncertain]:
        """The vertex last localized against, and the live robot in its frame."""
        return self.map.vertices[self.chain.branch], self.chain.T_branch_leaf()

    def start(self, target: VertexId | None) -> None:
        """Expects the robot at a vertex of the route, or at its first."""
        vertices = self.map.vertices
        index = vertices.index(target) if target in vertices else 0
        self.chain.start(index)
        around = self.chain.window(self._window.search, self._window.search)
        self._candidates = itertools.cycle(sorted(around, key=lambda i: abs(i - index)))

    def extend(self, vertices: Sequence[VertexId], path: Array) -> bool:
        """Goes on over a longer route without forgetting anything; False where it does not begin as the present one."""
        known = self.map.vertices
        if not self.metric or list(vertices[: len(known)]) != known:
            return False
        self.map.extend(vertices, path)
        self.chain.extend(path)
        self._wanted = None
        return True

    def metres_left(self) -> float:
        """From the trunk to the route's end."""
        return self.chain.metres_left()

    def T_end_leaf(self) -> Uncertain:
        """The live robot in the frame of the route's last vertex."""
        return self.chain.T_end_leaf()

    def actions(self) -> Array | None:
        """Taught actions (K, 3) ``[metres ahead of the robot, m/s, rad/s]`` to be replayed, for maps that have them."""
        return None

    def use(self, experiences: RouteExperiences) -> None:
        """Joins these experiences to the route's map from now on."""
        self.map.use(experiences)
        self._wanted = None

    def wanted(self) -> list[VertexId]:
        """Vertices whose submaps are or will soon be needed, nearest first."""
        trunk = self.chain.trunk
        if self._wanted is None or self._wanted[0] != trunk:
            around = self.chain.window(self._window.fetch_behind, self._window.fetch_ahead)
            self._wanted = trunk, self.map.wanted(sorted(around, key=lambda i: abs(i - trunk)))
        return self._wanted[1]

    def move(self, step: Step[Live]) -> None:
        """Takes a frame's odometry along without localizing."""
        self.chain.move(step)
        if self._wanted is None or self._wanted[0] != self.chain.trunk:
            self.map.rank(step.stamp)

    def follow(self, step: Step[Live]) -> Localized:
        """Localizes a frame, whose odometry was taken, against the trunk by the chain's prior."""
        prior = self.chain.T_trunk_leaf()
        joint = self.map.at(self.chain.trunk)
        if joint is None:
            return self._missing("the trunk's submap is not here yet")
        result = self._pipeline.localize(joint.submap, prior, step.live)
        self.map.credit(joint, result)
        if result.success:
            # The prior holds earlier localizations against much the same landmarks: it is no independent evidence.
            fused = covariance_intersection(prior, result.T_vertex_live)
            self.chain.localize(fused)
            result = replace(result, T_vertex_live=fused)
        return result

    def search(self, step: Step[Live]) -> Localized:
        """Looks for a robot whose place is not known by odometry, around the vertex that it was started at."""
        if self.chain.localized:
            result = self.follow(step)
            if result.success:
                return result
        result = self._missing("no submap is here yet to localize against")
        # Where it is assumed to be first, by the odometry since; then the others in turn.
        others = itertools.islice(self._candidates, self._window.searches)
        for index in dict.fromkeys(itertools.chain([self.chain.trunk], others)):
            joint = self.map.at(index)
            if joint is None:
                continue
            result = self._pipeline.search(joint.submap, step.live)
            if result.success:
                self.chain.start(index)
                self.chain.localize(result.T_vertex_live)
                return result
        return result

    def _missing(self, reason: str) -> Localized:
        prior = self.chain.T_trunk_leaf()
        return Localized(success=False, T_vertex_live=prior, inliers=0, stream="none", reason=reason)


def single_vertex_path() -> Array:
    """The path of a route that consists of its target alone."""
    return Uncertain.identity().T[None]
