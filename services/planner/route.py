"""The shortest route over what was taught."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from common.errors import GraphError
from common.geometry import Array
from common.ids import VertexId
from common.posegraph import PoseGraph

_ONE_WAY = "bearing"
"""The sensor whose maps hold no poses to drive back by."""

_LISTED = 8
"""Most names that a sentence lists."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Vertices to follow, and why these.

    Attributes:
        vertices: N of them, from the start to the goal.
        path: their poses ``T_first_vertex`` (N, 4, 4) in the first one's frame. Where the route goes against the
            direction in which it was taught, the poses look back: the robot follows them in reverse.
        length: metres along the edges.
        maps: whose vertices they are, in the order of their first use.
        reason: why this route, for a person.
    """

    vertices: list[VertexId]
    path: Array
    length: float
    maps: list[str]
    reason: str


def plan(
    graph: PoseGraph, start: VertexId, goal: str, sensor: str, blocked: Callable[[VertexId], bool] | None = None
) -> Plan:
    """The route of fewest metres over taught vertices, along temporal and spatial edges in either direction.

    Maps recorded in a repeat are no part of it: they help to localize on the path that was taught.

    Args:
        graph: the pose graph of the robot's environment.
        start: the vertex that the robot stands at.
        goal: a vertex (``map:index``), a map (its last vertex), or a named place.
        sensor: what the robot localizes by: maps that were taught by another are of no use to it.
        blocked: says of a vertex whether it must not be driven over.

    Raises:
        GraphError: nothing is taught, start or goal is unknown or was not taught or by another sensor, the robot is
            at the goal, or nothing connects the two.
    """
    if not any(experience.privileged and experience.vertices for experience in graph.experiences.values()):
        raise GraphError(f"environment '{graph.environment}' has no maps: teach a route first")
    _require_taught(graph, start, "the start", sensor)
    end = resolve(graph, goal)
    _require_taught(graph, end, f"the goal '{goal}'", sensor)
    if start == end:
        raise GraphError(f"the robot is at '{goal}' already ({end})")

    def allowed(vertex: VertexId) -> bool:
        if blocked is not None and blocked(vertex):
            return False
        return graph.privileged(vertex) and graph.experience(vertex.map_id).record.sensor == sensor

    if blocked is not None and blocked(end):
        raise GraphError(f"the goal '{goal}' ({end}) is on a stretch that is blocked")
    try:
        vertices = graph.shortest_path(start, end, allowed)
    except GraphError:
        raise GraphError(
            f"no taught route leads from {start} to '{goal}' ({end})"
            f"{' past what is blocked' if graph.restrictions else ''}: {_reachable(graph, start, allowed)}"
        ) from None
    _require_direction(graph, vertices)
    length = graph.length_along(vertices)
    maps = list(dict.fromkeys(vertex.map_id for vertex in vertices))
    return Plan(vertices, graph.poses_along(vertices), length, maps, _reason(vertices, length))


def resolve(graph: PoseGraph, goal: str) -> VertexId:
    """The vertex that a goal means: a named place, a map's last vertex, or ``map:index``.

    Raises:
        GraphError: there is none, with the names nearest to what was written.
    """
    if goal in graph.places:
        return graph.places[goal]
    experience = graph.experiences.get(goal)
    if experience is not None:
        if experience.vertices == 0:
            raise GraphError(f"map {goal} has no vertices yet, and so no end to drive to")
        return VertexId(goal, experience.vertices - 1)
    try:
        vertex = VertexId.parse(goal)
    except ValueError:
        raise GraphError(f"there is no place or map '{goal}'{_suggestion(graph, goal)}") from None
    if vertex.map_id not in graph.experiences:
        raise GraphError(f"there is no map '{vertex.map_id}'{_suggestion(graph, vertex.map_id)}")
    if vertex not in graph:
        raise GraphError(f"there is no vertex {vertex}: {_extent(graph, vertex.map_id)}")
    return vertex


def _require_taught(graph: PoseGraph, vertex: VertexId, role: str, sensor: str) -> None:
    if vertex not in graph:
        known = vertex.map_id in graph.experiences
        hint = _extent(graph, vertex.map_id) if known else f"environment '{graph.environment}' has no such map"
        raise GraphError(f"{role} {vertex} is unknown: {hint}")
    if not graph.privileged(vertex):
        record = graph.experience(vertex.map_id).record
        raise GraphError(
            f"{role} {vertex} was recorded in a repeat (generation {record.generation}): name a taught one"
        )
    taught_by = graph.experience(vertex.map_id).record.sensor
    if taught_by != sensor:
        raise GraphError(f"{role} {vertex} was taught by {taught_by}, and this robot localizes by {sensor}")


def _require_direction(graph: PoseGraph, vertices: Sequence[VertexId]) -> None:
    """Refuses a route against the direction in which a map was taught that replays what was commanded.

    Looking ahead while it drives backwards, a robot that holds the heading it sees would leave the path, not meet it.
    """
    for before, after in itertools.pairwise(vertices):
        if before.map_id != after.map_id or after.index > before.index:
            continue
        if graph.experience(before.map_id).record.sensor == _ONE_WAY:
            raise GraphError(
                f"the route from {vertices[0]} to {vertices[-1]} goes against the direction in which {before.map_id} "
                "was taught, and a map by bearing can only be repeated as it was taught: teach the way back"
            )


def _extent(graph: PoseGraph, map_id: str) -> str:
    count = graph.experience(map_id).vertices
    return f"the map has vertices 0 to {count - 1}" if count else "the map has no vertices yet"


def _suggestion(graph: PoseGraph, word: str) -> str:
    """The known names nearest to a word, or else the known places."""
    names = [*graph.places, *(k for k, experience in graph.experiences.items() if experience.privileged)]
    near = difflib.get_close_matches(word, names, 3)
    if near:
        return f"; did you mean {' or '.join(near)}?"
    if graph.places:
        return f"; the places are {_listed(sorted(graph.places))}"
    return "; no place has a name yet: name a vertex as map:index, or a map for its end"


def _reachable(graph: PoseGraph, start: VertexId, allowed: Callable[[VertexId], bool]) -> str:
    """Which places a robot can drive to, for somebody who named one that it cannot."""
    within = graph.reachable(start, allowed)
    places = sorted(name for name, vertex in graph.places.items() if vertex in within and vertex != start)
    return f"from there it can reach {_listed(places)}" if places else "from there it can reach no named place"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _reason(vertices: Sequence[VertexId], length: float) -> str:
    """How long it is and through which stretches of which maps it goes."""
    stretches = []
    for map_id, group in itertools.groupby(vertices, key=lambda vertex: vertex.map_id):
        indices = [vertex.index for vertex in group]
        stretches.append(f"{map_id}:{indices[0]}" + (f" to {indices[-1]}" if len(indices) > 1 else ""))
    return f"the shortest taught route, {length:.1f} m over {len(vertices)} vertices: {_listed(stretches)}"
