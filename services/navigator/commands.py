"""The operator's commands: what each asks of the other processes, and of the state machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import structlog

from common.errors import BusError, RetraverseError
from common.ids import VertexId, is_name
from common.messages import Command, Commit, Done, Goal, MapEnds, MapSummary, StateName
from services.navigator.ends import Sealer, place_of
from services.navigator.mission import Mission, MissionRefused
from services.navigator.plans import Changing, Plans, request_of
from services.navigator.questions import Questions, check_exists, exists
from services.navigator.settings import Settings

_ONE_WAY = "bearing"
"""The sensor whose maps have no poses that a loop closure could join."""

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class _Start:
    """The vertex that a mission starts at; where there is none, why."""

    vertex: VertexId | None
    remark: str = ""


class Commands:
    """Answers commands, each in a thread of its own.

    An answer that has to wait, for a plan or for the store, waits there, and never under the state machine's lock.
    ``changing`` gives the machine to one thread at a time, ``check_able`` refuses a command whose state lacks a process
    or that a latched emergency stop forbids.
    """

    def __init__(
        self,
        questions: Questions,
        plans: Plans,
        sealer: Sealer,
        changing: Changing,
        check_able: Callable[[str, StateName], None],
        environment: str,
        sensor: str,
        settings: Settings,
    ) -> None:
        self._questions = questions
        self._plans = plans
        self._sealer = sealer
        self._changing = changing
        self._check_able = check_able
        self._environment = environment
        self._sensor = sensor
        self._settings = settings
        self._handlers: dict[str, Callable[[Command], str]] = {
            "teach": self._teach,
            "finish": self._finish,
            "merge": self._merge,
            "confirm": self._confirm,
            "reject": self._reject,
            "branch": self._branch,
            "repeat": self._repeat,
            "append": self._append,
            "swap": self._swap,
            "drop": self._drop,
            "move": self._move,
            "pause": self._pause,
            "resume": self._resume,
            "cancel": self._cancel,
            "position": self._stand_at,
            "restrict": self._restrict,
        }

    def answer(self, command: Command) -> Done:
        """Carries a command out.

        Raises:
            RetraverseError: it is refused, and why.
        """
        return Done(text=self._handlers[command.action](command))

    # --- teaching ----------------------------------------------------------------------------------------------------

    def _teach(self, command: Command) -> str:
        environment = command.environment or self._environment
        self._check_startable("teach", StateName.TEACH_METRIC_LOCALIZE)
        maps = self._questions.maps(environment)
        start = self._start(command, environment, maps)
        place = command.start_place or place_of(start.vertex, maps)
        with self._changing() as machine:
            machine.teach(time.monotonic(), environment, start.vertex, place)
            remark = f" ({start.remark})" if start.remark else ""
            return f"teaching: {machine.mission.reason}{remark}"

    def _finish(self, command: Command) -> str:
        with self._changing() as machine:
            taught = machine.finish(time.monotonic())
        return self._finished(taught, command, command.end_place)

    def _merge(self, command: Command) -> str:
        if self._sensor == _ONE_WAY:
            raise MissionRefused(
                "maps by bearing hold no poses that a loop closure could join: finish this one instead"
            )
        if not command.candidates:
            raise MissionRefused("a merge needs candidates: vertices that the map may meet, as map:index")
        with self._changing() as machine:
            machine.check("merge")
            environment = machine.mission.environment
        maps = self._questions.maps(environment)
        for vertex in command.candidates:
            check_exists(vertex, maps, environment)
        with self._changing() as machine:
            machine.merge(time.monotonic(), tuple(command.candidates))
            return f"looking for a loop closure: {machine.mission.waiting_for}"

    def _confirm(self, command: Command) -> str:
        """The edge is durable first; then the map ends, which nothing can undo."""
        with self._changing() as machine:
            machine.check("confirm")
            closure, environment = machine.mission.closure, machine.mission.environment
        if closure is None:
            raise MissionRefused("there is no loop closure to confirm")
        self._questions.commit(Commit(edges=[closure.edge]))
        log.info("a loop closure is confirmed", a=str(closure.edge.a), b=str(closure.edge.b))
        met = place_of(closure.edge.b, self._questions.maps(environment))
        with self._changing() as machine:
            taught = machine.confirm(time.monotonic())
        return f"{self._finished(taught, command, command.end_place or met)}, and meets {closure.edge.b}"

    def _reject(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.reject(time.monotonic())
            return f"{machine.mission.reason}; waiting for {machine.mission.waiting_for}"

    def _branch(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.branch(time.monotonic())
            return machine.mission.reason

    def _finished(self, taught: Mission, command: Command, end_place: str | None) -> str:
        """Names the ends of a map that has ended; a place that the map only meets keeps the vertex that it has."""
        if taught.map is None:  # the table lets a map be finished only where there is one
            raise MissionRefused("no map was being taught")
        stored = self._questions.await_finished(taught.map)
        start_place = command.start_place or taught.start_place
        for place, index in ((start_place, 0), (command.end_place, stored.vertices - 1)):
            if place is not None and is_name(place):
                self._questions.name_place(taught.environment, place, VertexId(taught.map.id, index))
        ends = MapEnds(map=taught.map.id, start_place=start_place, end_place=end_place)
        try:
            self._questions.tell_ends(ends)
        except BusError:
            self._sealer.seal(taught.map, lambda _: ends)
        return f"map {taught.map.id} is stored: {stored.vertices} vertices, {stored.length:.1f} m"

    # --- repeating ---------------------------------------------------------------------------------------------------

    def _repeat(self, command: Command) -> str:
        environment = command.environment or self._environment
        self._check_startable("repeat", StateName.REPEAT_PLAN)
        goal = _goal(command)
        maps = self._questions.maps(environment)
        at_place = command.start_place is not None and command.vertex is None
        if not at_place and not any(m.record.generation == 0 for m in maps):
            raise MissionRefused(f"environment '{environment}' has no map that could be repeated: teach one first")
        start = _Start(None) if at_place else self._start(command, environment, maps)
        if start.vertex is None and not at_place:
            raise MissionRefused(
                f"it is unknown where the robot stands in '{environment}': name its vertex ({start.remark})"
            )
        if at_place and goal.pause_before:
            raise MissionRefused("a rest before the first goal needs a vertex, not a place, to start from")
        with self._changing() as machine:
            attempt = machine.repeat(time.monotonic(), environment, start.vertex, goal)
            if not attempt:
                return f"resting for {goal.pause_before:g} s, then {goal.to}"
        request = request_of(goal, environment, start.vertex, command.start_place if at_place else None)
        return self._plans.begin(attempt, request, record=self._plans.records(goal))

    def _append(self, command: Command) -> str:
        goal = _goal(command)
        with self._changing() as machine:
            machine.append(time.monotonic(), goal)
            mission = machine.mission
            return f"{goal.to} is goal {len(mission.goals)} of those that wait behind {mission.destination}"

    def _swap(self, command: Command) -> str:
        goal = _goal(command)
        self._check_able("swap", StateName.REPEAT_PLAN)
        return self._replan(goal, f"the operator sends the robot to {goal.to} instead")

    def _drop(self, command: Command) -> str:
        if command.number is None:
            raise MissionRefused("say which of the waiting goals to drop, counted from 1")
        with self._changing() as machine:
            dropped = machine.drop(command.number)
        return f"{dropped.to} is no goal any longer"

    def _move(self, command: Command) -> str:
        if command.number is None or command.to is None:
            raise MissionRefused("say which of the waiting goals to move, and where to, both counted from 1")
        with self._changing() as machine:
            moved = machine.move(command.number, command.to)
        return f"{moved.to} is goal {command.to} of those that wait"

    def _replan(self, goal: Goal, reason: str) -> str:
        """Plans the rest of a repeat anew, from where the robot was localized last."""
        with self._changing() as machine:
            attempt = machine.swap(time.monotonic(), goal, reason)
            mission = machine.mission
        request = request_of(goal, mission.environment, mission.position)
        return self._plans.begin(attempt, request, record=self._plans.records(goal))

    def _restrict(self, command: Command) -> str:
        if command.restriction is None:
            raise MissionRefused("say which stretch to restrict")
        text = self._questions.restrict(command.restriction).text
        with self._changing() as machine:
            mission = machine.mission
        if mission.goal is None or not mission.route or mission.name is StateName.PAUSED:
            return text
        return f"{text}; planned anew: {self._replan(mission.goal, 'the operator has changed what is restricted')}"

    # --- both --------------------------------------------------------------------------------------------------------

    def _pause(self, command: Command) -> str:
        now = time.monotonic()
        with self._changing() as machine:
            if not command.at_vertex:
                machine.pause(now)
                return f"the robot is {machine.mission.doing}"
            machine.check("pause_ahead")
            vertex = self._plans.vertex_ahead(machine.mission.position, self._settings.pause_ahead_m)
            if vertex is None:
                raise MissionRefused(
                    "no vertex of the route lies far enough ahead to pause at: the robot is nearly there"
                )
            machine.pause_ahead(now, vertex)
            return f"the robot will pause at {vertex}"

    def _resume(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.check("resume")
            resumes = machine.mission.resumes
            self._check_able("resume", resumes or StateName.IDLE)
            machine.resume(time.monotonic())
            mission, attempt = machine.mission, machine.plans_anew()
        if attempt is None or mission.goal is None:
            return f"the robot is {mission.doing}"
        request = request_of(mission.goal, mission.environment, mission.position)
        return self._plans.begin(attempt, request, record=self._plans.records(mission.goal))

    def _cancel(self, _command: Command) -> str:
        with self._changing() as machine:
            machine.cancel(time.monotonic())
            return f"the robot is {machine.mission.doing}"

    def _stand_at(self, command: Command) -> str:
        """In a repeat, the robot stops first, and goes on from there by another plan."""
        environment = command.environment or self._environment
        if (command.vertex is None) != command.find:
            raise MissionRefused("a position is a vertex, written as map:index, or is to be found by the robot itself")
        with self._changing() as machine:
            machine.check("position")
            goal = machine.mission.goal
            if goal is not None and environment != machine.mission.environment:
                raise MissionRefused(f"the robot repeats in '{machine.mission.environment}': cancel that first")
            if goal is not None and machine.mission.name is not StateName.PAUSED:
                machine.pause(time.monotonic())
        vertex, remark = command.vertex, ""
        if vertex is None:
            found = self._questions.where(environment)
            vertex, remark = found.vertex, f": {found.inliers} landmarks agree"
        check_exists(vertex, self._questions.maps(environment), environment)
        with self._changing() as machine:
            machine.stand_at(environment, vertex)
        text = f"the robot stands at {vertex}{remark}"
        if goal is None:
            return text
        self._check_able("go on with the repeat", StateName.REPEAT_PLAN)
        return f"{text}; planned anew: {self._replan(goal, text)}"

    # --- what commands ask for ---------------------------------------------------------------------------------------

    def _check_startable(self, command: str, state: StateName) -> None:
        with self._changing() as machine:
            machine.check(command)
        self._check_able(command, state)

    def _start(self, command: Command, environment: str, maps: list[MapSummary]) -> _Start:
        """Where the robot stands: by the operator's word, else as it is known, else as the estimator finds it."""
        if command.vertex is not None:
            check_exists(command.vertex, maps, environment)
            return _Start(command.vertex)
        with self._changing() as machine:
            mission = machine.mission
        if mission.environment == environment and mission.position is not None and exists(mission.position, maps):
            return _Start(mission.position)
        if not maps:
            return _Start(None)
        try:
            found = self._questions.where(environment)
        except RetraverseError as error:
            return _Start(None, f"it did not find itself: {error}")
        log.info("the robot found itself", vertex=str(found.vertex), inliers=found.inliers)
        return _Start(found.vertex)


def _goal(command: Command) -> Goal:
    if command.goal is None or not command.goal.to:
        raise MissionRefused("a repeat needs a goal: a place, a map, or a vertex as map:index")
    return command.goal
