"""A route for a request: over the maps that serve best now where places are asked for, else the shortest one."""

from __future__ import annotations

import secrets
from dataclasses import replace

import structlog

from common.environment import MODES, Theta
from common.environment.told import model_told
from common.errors import GraphError, Refused
from common.ids import VertexId
from common.messages import PlanRequest, Route, now_ns
from common.posegraph import PoseGraph
from services.planner.choice import Chosen, Whence, choose, entries_of, hours, merged, whence
from services.planner.fleet import Fleet
from services.planner.joints import Chained, chain
from services.planner.memory import Memory
from services.planner.restrictions import Blocked, Restrictions
from services.planner.route import plan as shortest
from services.planner.settings import Settings

log = structlog.get_logger()


class Planner:
    """Makes routes over a pose graph, by what is known of the fleet."""

    def __init__(self, settings: Settings, sensor: str, memory: Memory, fleet: Fleet) -> None:
        self._settings = settings
        self._sensor = sensor
        self._memory = memory
        self._fleet = fleet

    def route(self, request: PlanRequest, graph: PoseGraph) -> Route:
        """The route.

        Raises:
            GraphError: there is none, and why.
            Unavailable: maps of it are being fetched: the same may be asked again.
            Refused: maps of it cannot be had.
        """
        restrictions = Restrictions(graph.restrictions)
        if request.plan:
            return self._over(
                request, graph, _start_on(request, request.plan[0]), Chosen(request.plan, []), restrictions
            )
        reason = ""
        if self._names_a_place(request, graph):
            try:
                chosen, start = self._choose(request, graph, restrictions)
            except (GraphError, Refused) as error:
                if request.start is None:
                    raise GraphError(str(error)) from None
                reason = f"; no plan over whole maps ({error})"
            else:
                try:
                    return self._over(request, graph, start, chosen, restrictions)
                except Blocked as error:
                    if request.start is None:
                        raise
                    reason = f"; no plan over whole maps ({error})"
        if request.start is None:
            raise GraphError(
                f"'{request.goal}' is no place that maps lead to, so the vertex of the start must be named"
            )
        found = shortest(graph, request.start, request.goal, self._sensor, restrictions.blocked)
        chained = Chained(found.vertices, found.path, found.length, found.maps, None)
        return _message(request, chained, found.maps, found.reason + reason, [], restrictions)

    def _names_a_place(self, request: PlanRequest, graph: PoseGraph) -> bool:
        """Whether the goal may be a place that maps lead to; a map or a vertex is none."""
        if request.goal in graph.experiences:
            return False
        try:
            vertex = VertexId.parse(request.goal)
        except ValueError:
            return True
        ends = {experience.end_place for experience in graph.experiences.values()}
        return request.goal in ends or vertex.map_id not in graph.experiences

    def _choose(
        self, request: PlanRequest, graph: PoseGraph, restrictions: Restrictions
    ) -> tuple[Chosen, VertexId | None]:
        """The maps for now, and the vertex of the first one that the robot stands at, if it is known."""
        begin = self._whence(request, graph)
        if begin.place == request.goal:
            maps = [begin.before] if begin.before is not None else []
            if not maps:
                raise GraphError(f"the robot is at '{request.goal}' already")
            return Chosen(maps, [f"the rest of {maps[0]}, on which the robot stands, leads there"]), request.start
        theta = self._theta(request)
        blocked = restrictions.blocked_maps()
        found = self._fleet.plan(request.environment, begin.place, request.goal, theta, blocked)
        if found is None:
            learnt = self._memory.recall(request.environment)
            known = merged(entries_of(graph), learnt.entries)
            entries = [entry for entry in known if entry.map not in blocked]
            model = model_told(learnt.model)
            found = choose(entries, model, begin.place, request.goal, hours(now_ns()), theta, self._sensor)
        if begin.before is None:
            return found, _start_on(request, found.maps[0])
        why = [f"the rest of {begin.before}, on which the robot stands, leads to {begin.place}", *found.why]
        return Chosen([begin.before, *found.maps], why), request.start

    def _whence(self, request: PlanRequest, graph: PoseGraph) -> Whence:
        if request.start_place is not None:
            return Whence(request.start_place)
        start = request.start
        if start is None or start not in graph:
            raise GraphError(f"there is no vertex {start} to start at")
        found = whence(graph, start)
        if found is None:
            raise GraphError(f"map {start.map_id}, on which the robot stands, leads to no place")
        return found

    def _theta(self, request: PlanRequest) -> Theta:
        settings = self._settings
        if request.theta is not None:
            chosen = Theta(*request.theta)
        elif request.mode is not None:
            chosen = MODES[request.mode]
        else:
            chosen = MODES[settings.mode] if settings.theta is None else Theta(*settings.theta)
        return replace(chosen, trouble=settings.trouble_weight)

    def _over(
        self,
        request: PlanRequest,
        graph: PoseGraph,
        start: VertexId | None,
        chosen: Chosen,
        restrictions: Restrictions,
    ) -> Route:
        """The route over chosen maps, once all of them are here."""
        missing = [map_id for map_id in chosen.maps if map_id not in graph.experiences]
        if missing:
            raise self._fleet.fetch(request.environment, missing, len(chosen.maps))
        first = VertexId(chosen.maps[0], 0)
        if start is None and request.start is not None and request.start in graph:
            chained = self._from_elsewhere(request.start, graph, chosen)
        else:
            chained = chain(graph, start or first, chosen.maps)
        restrictions.require_free(chained.vertices)
        reason = " ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in chosen.why[-1:])
        text = (
            f"{len(chosen.maps)} map{'s' * (len(chosen.maps) > 1)}, chosen for now: {', '.join(chosen.maps)}. {reason}"
        )
        return _message(request, chained, chosen.maps, text.strip(), chosen.why, restrictions)

    @staticmethod
    def _from_elsewhere(start: VertexId, graph: PoseGraph, chosen: Chosen) -> Chained:
        """The robot stands at the end of another map: its last vertex, and on over the first of the plan if it can."""
        led = chain(graph, start, [start.map_id, *chosen.maps])
        if led.next_map == chosen.maps[0]:
            return chain(graph, VertexId(chosen.maps[0], 0), chosen.maps)
        return led


def _start_on(request: PlanRequest, map_id: str) -> VertexId | None:
    """The vertex that the robot stands at, if it is one of a map."""
    return request.start if request.start is not None and request.start.map_id == map_id else None


def _message(
    request: PlanRequest, chained: Chained, maps: list[str], reason: str, why: list[str], restrictions: Restrictions
) -> Route:
    return Route(
        id=secrets.token_hex(6),
        environment=request.environment,
        goal=request.goal,
        vertices=chained.vertices,
        path=chained.path,
        length=chained.length,
        maps=chained.maps,
        reason=reason[:2000],
        plan=maps,
        next_map=chained.next_map,
        why=[sentence[:2000] for sentence in why],
        speed_limits=restrictions.speed_limits(chained.vertices),
    )
