"""A route over maps that were chosen, one after another, as far as it is known how they join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common import geometry
from common.errors import GraphError
from common.geometry import Array
from common.ids import VertexId
from common.posegraph import PoseGraph


@dataclass(frozen=True, slots=True)
class JointSettings:
    """When a route goes from one map's end on to the next map.

    Attributes:
        reach: metres along edges within which the next map's vertices are looked for, from the end of the map before.
        overlap: metres of the next map's beginning that may lie beside or behind that end, and are left out.
        ahead: a vertex to go on to lies at least so far ahead of it, metres.
        gap: and at most so far away, metres.
        turn: and is turned by no more than this against it, radians.
    """

    reach: float = 25.0
    overlap: float = 15.0
    ahead: float = 0.2
    gap: float = 5.0
    turn: float = 0.8


@dataclass(frozen=True, slots=True)
class Chained:
    """Vertices to follow over the first maps of a plan.

    Attributes:
        vertices: N of them.
        path: ``T_first_vertex`` (N, 4, 4).
        length: metres.
        maps: those that are reached, in order.
        next_map: the first that is not, for nothing tells where it joins; None where all are.
    """

    vertices: list[VertexId]
    path: Array
    length: float
    maps: list[str]
    next_map: str | None


def chain(graph: PoseGraph, start: VertexId, plan: Sequence[str], settings: JointSettings | None = None) -> Chained:
    """The route from a vertex of a plan's first map over the maps that follow.

    A route of the same start and plan that goes further, for an edge was found since, begins with the same vertices.

    Raises:
        GraphError: a map or the start is unknown, or the start is none of the first map.
    """
    settings = settings or JointSettings()
    if not plan or start.map_id != plan[0] or start not in graph:
        raise GraphError(f"the route cannot begin at {start}, which is no vertex of the plan's first map")
    vertices = graph.vertices(plan[0])[start.index :]
    poses = graph.poses_along(vertices)
    reached = [plan[0]]
    for map_id in plan[1:]:
        joint = _joint(graph, vertices[-1], map_id, settings)
        if joint is None:
            break
        first, T_last_first = joint
        following = graph.vertices(map_id)[first.index :]
        base = poses[-1] @ T_last_first
        poses = np.concatenate([poses, base @ graph.poses_along(following)])
        vertices += following
        reached.append(map_id)
    length = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    return Chained(vertices, poses, length, reached, plan[len(reached)] if len(reached) < len(plan) else None)


def _joint(graph: PoseGraph, last: VertexId, map_id: str, settings: JointSettings) -> tuple[VertexId, Array] | None:
    """The first vertex of a map that lies well ahead of the end of another, and ``T_last_vertex``; None if unknown."""
    near = (vertex for vertex in graph.within(last, settings.reach) if vertex.map_id == map_id)
    found = next(near, None)
    if found is None:
        return None
    T_last_found = graph.transform(last, found).T
    candidates = graph.vertices(map_id)
    begin = min(found.index, len(candidates) - 1)
    T_found_first = graph.poses_along(candidates[begin::-1])[-1]
    poses = T_last_found @ T_found_first @ graph.poses_along(candidates)
    arclength = geometry.arclength(poses)
    offset = poses[:, :3, 3]
    good = (offset[:, 0] >= settings.ahead) & (np.linalg.norm(offset, axis=1) <= settings.gap)
    good &= (np.abs(geometry.yaw_of(poses)) <= settings.turn) & (arclength <= settings.overlap)
    if not good.any():
        return None
    k = int(np.argmax(good))
    return candidates[k], poses[k]
