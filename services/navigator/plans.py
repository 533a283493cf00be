"""Routes asked of the planner: at a repeat's beginning, until its maps are here, and on the way for what comes next."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
import structlog

from common import geometry
from common.errors import BusError, RetraverseError, Unavailable
from common.ids import VertexId
from common.messages import Goal, MapSummary, PlanRequest, Route, StateName
from services.navigator.machine import StateMachine
from services.navigator.mission import MissionRefused
from services.navigator.questions import Questions, record_of
from services.navigator.settings import Settings

_FETCH_PERIOD_S = 0.5
_GO_ON_PERIOD_S = 0.7
_SOON_PERIOD_S = 0.15
"""The shorter one where the end is near: a longer route that comes in time costs no speed."""

log = structlog.get_logger()

Changing = Callable[[], AbstractContextManager[StateMachine]]


@dataclass(frozen=True, slots=True)
class Waiting:
    """A plan whose maps are being fetched: which attempt, what was asked, and whether the repeat is recorded."""

    attempt: int
    request: PlanRequest
    record: bool


class Plans:
    """The route that is followed, and the thread that asks for more of it.

    ``changing`` gives the state machine to one thread at a time, ``publish`` sends a route to whoever follows it.

    Attributes:
        route: the newest; None before any.
        maps: the environment's maps when it came.
    """

    def __init__(
        self, questions: Questions, settings: Settings, changing: Changing, publish: Callable[[Route], None]
    ) -> None:
        self._questions = questions
        self._settings = settings
        self._changing = changing
        self._publish = publish
        self._waiting: Waiting | None = None
        self._stranded = False
        self._awake = threading.Event()
        self._remaining = float("inf")
        self.route: Route | None = None
        self.maps: list[MapSummary] = []

    def begin(self, attempt: int, request: PlanRequest, *, record: bool) -> str:
        """Asks for a route, and hands it on if it is there at once; what is fetched first is waited for elsewhere.

        Raises:
            RetraverseError: the planner's refusal.
            MissionRefused: the plan came too late.
        """
        waiting = Waiting(attempt, request, record)
        try:
            return self._take(waiting, self._questions.route(request))
        except Unavailable as error:
            self._patient(waiting, str(error), time.monotonic() + self._settings.fetch_s)
            self._waiting = waiting
            return f"waiting for a plan to {request.goal}: {error}"
        except RetraverseError as error:
            self._give_up(waiting, str(error))
            raise

    def progress(self, remaining: float) -> None:
        """Hears how many metres of the route remain."""
        self._remaining = remaining

    def ends_early(self, route: str) -> bool:
        """At a route's end: whether its plan goes on; then the way to the next map is looked for where the robot is."""
        if self.route is None or self.route.id != route or self.route.next_map is None:
            return False
        self._stranded = True
        self._awake.set()
        return True

    def wake(self) -> None:
        """Says that a repeat waits for a plan that nobody was asked for."""
        self._awake.set()

    def records(self, goal: Goal) -> bool:
        """Whether an experience is recorded on the way to a goal: an exploring one always is."""
        explores = goal.mode == "explore" or min(goal.theta or (0.0,)) < 0.0
        return (self._settings.record_repeats or explores) if goal.record is None else goal.record

    def vertex_ahead(self, position: VertexId | None, metres: float) -> VertexId | None:
        """The first vertex of the route that lies so far ahead of another one; None where the route ends before."""
        if self.route is None or position not in self.route.vertices:
            return None
        at = geometry.arclength(self.route.path)
        here = at[self.route.vertices.index(position)]
        ahead = int(np.searchsorted(at, here + metres))
        return self.route.vertices[ahead] if ahead < len(at) else None

    def run(self, stop: threading.Event) -> None:
        """Plans the way to goals that waited, waits for maps, and asks for what comes next, until the service stops."""
        while not stop.is_set():
            if self._waiting is not None:
                self._fetch(self._waiting, stop)
            elif not self._plan_next():
                self._go_on()
            if self._stranded:
                stop.wait(_SOON_PERIOD_S)
                continue
            self._awake.wait(_SOON_PERIOD_S if self._remaining < self._settings.go_on_m / 2.0 else _GO_ON_PERIOD_S)
            self._awake.clear()

    def _plan_next(self) -> bool:
        """Asks for the plan that a repeat waits for, if nobody has; returns whether one was asked for."""
        with self._changing() as machine:
            attempt, mission = machine.plans_anew(), machine.mission
        if attempt is None or mission.goal is None:
            return False
        goal = mission.goal
        request = request_of(goal, mission.environment, mission.position)
        try:
            self.begin(attempt, request, record=self.records(goal))
        except RetraverseError as error:
            log.warning("no plan to the next goal", goal=goal.to, reason=str(error))
        return True

    # --- maps that are fetched ---------------------------------------------------------------------------------------

    def _fetch(self, waiting: Waiting, stop: threading.Event) -> None:
        """Asks again and again while something comes."""
        told, patience = "", 0.0
        while not stop.wait(_FETCH_PERIOD_S):
            try:
                self._take(waiting, self._questions.route(waiting.request))
            except Unavailable as error:
                now = time.monotonic()
                if str(error) != told:
                    told, patience = str(error), now + self._settings.fetch_s
                if now > patience:
                    self._give_up(waiting, told)
                elif self._patient(waiting, told, patience):
                    continue
            except MissionRefused:
                log.info("nobody waits for the plan any longer", goal=waiting.request.goal)
            except RetraverseError as error:
                self._give_up(waiting, str(error))
            break
        self._waiting = None

    def _patient(self, waiting: Waiting, awaited: str, patience: float) -> bool:
        with self._changing() as machine:
            return machine.fetching(waiting.attempt, awaited, patience)

    def _give_up(self, waiting: Waiting, reason: str) -> None:
        with self._changing() as machine:
            machine.not_planned(time.monotonic(), waiting.attempt, f"no route to {waiting.request.goal}: {reason}")

    def _take(self, waiting: Waiting, route: Route) -> str:
        """Hands a route on."""
        text = f"{route.length:.1f} m to {route.goal}: {route.reason}"
        self._set(route)
        repeated = record_of(route.vertices[0].map_id, self.maps) if waiting.record else None
        with self._changing() as machine:
            if not machine.planned(time.monotonic(), waiting.attempt, route.id, route.vertices[0], text, repeated):
                raise MissionRefused(f"the plan came too late: the robot is {machine.mission.doing}")
        return text

    def _set(self, route: Route) -> None:
        """The route goes first, so that whoever sees the state that names it has it."""
        self.maps = self._questions.maps(route.environment)
        self._remaining = float("inf")
        self.route = route
        self._stranded = False
        self._publish(route)

    # --- what comes next ---------------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        """Asks for a longer route near the end of one whose plan goes on, and at the end for the next one."""
        route, stranded = self.route, self._stranded
        if route is None or route.next_map is None or not (stranded or self._remaining < self._settings.go_on_m):
            return
        with self._changing() as machine:
            mission = machine.mission
        if mission.name is not StateName.REPEAT_FOLLOW or mission.route != route.id:
            return
        try:
            if not self._extend(route) and stranded:
                self._start_next(route, route.next_map)
        except BusError as error:
            log.warning("the route cannot be gone on with now", reason=str(error))

    def _extend(self, route: Route) -> bool:
        request = PlanRequest(environment=route.environment, start=route.vertices[0], goal=route.goal, plan=route.plan)
        longer = self._questions.route(request)
        known = len(route.vertices)
        if len(longer.vertices) <= known or longer.vertices[:known] != route.vertices:
            return False
        self._set(longer)
        with self._changing() as machine:
            if machine.extended(time.monotonic(), route.id, longer.id):
                log.info("the route goes on", maps=longer.maps, length=round(longer.length, 1))
        return True

    def _start_next(self, route: Route, next_map: str) -> None:
        """The robot stands at the end, and finds itself on the next map's first vertices."""
        rest = route.plan[route.plan.index(next_map) :]
        target = VertexId(next_map, 0)
        request = PlanRequest(environment=route.environment, start=target, goal=route.goal, plan=rest)
        following = self._questions.route(request)
        self._set(following)
        reason = f"at the end of {route.maps[-1]}, from which no edge leads to {next_map}: it finds itself there"
        with self._changing() as machine:
            machine.goes_on(time.monotonic(), route.id, following.id, target, reason)


def request_of(goal: Goal, environment: str, start: VertexId | None, start_place: str | None = None) -> PlanRequest:
    """What the planner is asked for a goal."""
    return PlanRequest(
        environment=environment, start=start, start_place=start_place, goal=goal.to, mode=goal.mode, theta=goal.theta
    )
