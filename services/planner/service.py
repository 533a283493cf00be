"""Answers ``plan`` from the map store's newest graph, or from the last one while the store is away."""

from __future__ import annotations

import secrets
import time

import structlog

from common import topics
from common.bus import Bus
from common.errors import BusError, GraphError
from common.messages import GraphQuery, PlanRequest, Route
from common.posegraph import PoseGraph, from_topology
from common.service import Service
from services.planner.route import plan
from services.planner.settings import Settings

log = structlog.get_logger()


class Graphs:
    """The environments' pose graphs, each as the map store last gave it."""

    def __init__(self, bus: Bus, timeout_s: float) -> None:
        self._bus = bus
        self._timeout_s = timeout_s
        self._last: dict[str, tuple[PoseGraph, float]] = {}

    def get(self, environment: str) -> tuple[PoseGraph, str]:
        """The newest graph that can be had, and a remark on its age where the store does not give one.

        Raises:
            BusError: the store does not answer, and never did for this environment.
            GraphError: what the store gave contradicts itself.
        """
        query = GraphQuery(environment=environment)
        try:
            graph = from_topology(self._bus.ask(topics.TOPOLOGY, query, self._timeout_s))
        except BusError as error:
            if environment not in self._last:
                raise
            graph, when = self._last[environment]
            log.warning("planning without the map store", reason=str(error))
            return graph, f"; by the maps of {time.monotonic() - when:.0f} s ago, since the map store gives none now"
        self._last[environment] = graph, time.monotonic()
        return graph, ""


def main(service: Service) -> None:
    """Answers until the service is stopped."""
    settings = service.config.settings("planner", Settings)
    graphs = Graphs(service.bus, settings.store_timeout_s)

    def answer(request: PlanRequest) -> Route:
        with service.stage("plan"):
            graph, remark = graphs.get(request.environment)
            return _route(request, graph, service.config.robot.sensor, remark)

    service.bus.serve(topics.PLAN, answer)
    service.ready()
    service.stop.wait()


def _route(request: PlanRequest, graph: PoseGraph, sensor: str, remark: str) -> Route:
    try:
        found = plan(graph, request.start, request.goal, sensor)
    except GraphError as error:
        raise GraphError(f"{error}{remark}") from None
    log.info("planned", start=str(request.start), goal=request.goal, length=round(found.length, 2), reason=found.reason)
    return Route(
        id=secrets.token_hex(6),
        environment=request.environment,
        goal=request.goal,
        vertices=found.vertices,
        path=found.path,
        length=found.length,
        maps=found.maps,
        reason=found.reason + remark,
    )
