"""Answers ``plan`` from the map store's newest graph, or from the last one while the store is away."""

from __future__ import annotations

import time

import structlog

from common import topics
from common.bus import Bus
from common.environment import warm_up
from common.errors import BusError, GraphError
from common.messages import GraphQuery, PlanRequest, Route
from common.posegraph import PoseGraph, from_topology
from common.service import Service
from services.planner.fleet import Fleet
from services.planner.memory import Memory
from services.planner.planning import Planner
from services.planner.settings import Settings

_LISTEN_S = 1.0

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
    memory = Memory(service.config.directory / "fleet")
    sensor = service.config.robot.sensor
    fleet = Fleet(service.bus, memory, settings, sensor, linked=service.config.bus.fleet is not None)
    planner = Planner(settings, sensor, memory, fleet)

    def answer(request: PlanRequest) -> Route:
        with service.stage("plan"):
            fleet.listen()
            graph, remark = graphs.get(request.environment)
            try:
                route = planner.route(request, graph)
            except GraphError as error:
                raise GraphError(f"{error}{remark}") from None
            log.info("planned", goal=route.goal, length=round(route.length, 2), maps=route.plan, reason=route.reason)
            return route.model_copy(update={"reason": (route.reason + remark)[:2000]})

    warm_up()
    service.bus.serve(topics.PLAN, answer)
    service.ready()
    while not service.stop.wait(_LISTEN_S):
        fleet.listen()
