"""The mission: what the robot is doing, why, and what each command and event makes of it. Knows no bus and no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from common.errors import RetraverseError
from common.ids import VertexId
from common.messages import MapRecord, StateName
from services.navigator.hierarchy import Hierarchy


class MissionRefused(RetraverseError):
    """A command that the present state does not allow."""


@dataclass(frozen=True, slots=True)
class Deadlines:
    """Seconds that a waiting state may last before it ends in Idle."""

    plan: float
    localize: float
    paused: float


@dataclass(frozen=True, slots=True)
class Mission:
    """What the robot is doing. Of the fields below ``position``, Idle keeps none.

    Attributes:
        name: the state.
        since: monotonic time (s) since when.
        reason: why, in a sentence or a part of one.
        environment: where ``position`` and all the rest belong.
        position: the vertex last localized against, or taught last, or told by the operator.
        resumes: the state behind a pause.
        target: the vertex to localize against.
        map: the map that is being taught, or recorded on the way of a repeat.
        start_place: the name that the map's first vertex will get.
        goal: where a repeat goes, in the operator's words.
        attempt: tells the plan that is waited for from the answer to an earlier question.
        route: id of the planned route.
    """

    name: StateName
    since: float
    reason: str
    environment: str
    position: VertexId | None = None
    resumes: StateName | None = None
    target: VertexId | None = None
    map: MapRecord | None = None
    start_place: str | None = None
    goal: str = ""
    attempt: int = 0
    route: str = ""

    @property
    def doing(self) -> str:
        """The state within a sentence."""
        return f"paused in {self.resumes}" if self.name is StateName.PAUSED else f"in {self.name}"

    @property
    def waiting_for(self) -> str:
        """What ends this state, where the robot waits for it."""
        match self.name:
            case StateName.TEACH_METRIC_LOCALIZE | StateName.REPEAT_METRIC_LOCALIZE:
                return f"a localization against {self.target}"
            case StateName.TEACH_BRANCH:
                return "the operator, who drives and then finishes the map"
            case StateName.REPEAT_PLAN:
                return f"a plan to {self.goal}"
            case StateName.PAUSED:
                return "the operator, who resumes or cancels"
            case _:
                return ""


_REFUSALS: Mapping[str, str] = {
    "teach": "a map can be taught from Idle only, and the robot is {doing}: finish or cancel that first",
    "repeat": "a repeat starts from Idle only, and the robot is {doing}: finish or cancel that first",
    "finish": "no map is being taught that could be finished: the robot is {doing}",
    "pause": "there is nothing to pause: the robot is {doing}",
    "resume": "there is nothing to resume: the robot is {doing}, not paused",
    "position": "the robot's position can be set in Idle only, and the robot is {doing}",
}


class StateMachine:
    """The navigator's states, driven by commands, which may be refused, and by events, which may mean nothing now.

    Every method takes the monotonic time ``now`` in seconds. Not thread-safe.
    """

    def __init__(
        self,
        environment: str,
        position: VertexId | None,
        deadlines: Deadlines,
        new_map: Callable[[str, MapRecord | None], MapRecord],
        now: float,
    ) -> None:
        """Starts in Idle.

        ``new_map`` makes the record of a map of an environment: of a taught one or, with the record of the map that is
        repeated, of one recorded on the way.
        """
        self._hierarchy = Hierarchy()
        self._new_map = new_map
        self._limits: Mapping[StateName, float] = {
            StateName.TEACH_METRIC_LOCALIZE: deadlines.localize,
            StateName.REPEAT_PLAN: deadlines.plan,
            StateName.REPEAT_METRIC_LOCALIZE: deadlines.localize,
            StateName.PAUSED: deadlines.paused,
        }
        self._attempts = 0
        self.mission = Mission(StateName.IDLE, now, "started", environment, position)

    # --- commands ----------------------------------------------------------------------------------------------------

    def teach(self, now: float, environment: str, target: VertexId | None, start_place: str | None = None) -> None:
        """Starts a map: at a vertex to localize against first, or without one unconnected to any other.

        Raises:
            MissionRefused: as every command does where the state does not allow it.
        """
        changes = {"environment": environment, "target": target, "position": target, "start_place": start_place}
        reason = f"a map is to branch off {target}" if target else "a map is taught that joins no other"
        self._command("teach", now, reason, **changes)

    def finish(self, now: float) -> Mission:
        """Ends the map that is being taught; returns the mission that was."""
        before = self.mission
        self._command("finish", now, f"finished map {before.map.id if before.map else ''}")
        return before

    def repeat(self, now: float, environment: str, start: VertexId, goal: str) -> int:
        """Waits for a route from a vertex to a goal; returns the attempt to name with its answer."""
        self._attempts += 1
        changes = {"environment": environment, "position": start, "goal": goal, "attempt": self._attempts}
        self._command("repeat", now, f"the operator sends the robot to {goal}", **changes)
        return self._attempts

    def pause(self, now: float) -> None:
        """Stops the robot and keeps what it was doing."""
        self._command("pause", now, "paused by the operator")

    def resume(self, now: float) -> None:
        """Goes on with what a pause holds; a repeat is localized anew, against the vertex of the last localization."""
        self._command("resume", now, "resumed by the operator")

    def cancel(self, now: float) -> None:
        """Ends in Idle whatever it was doing; a map that is being taught stays as it stands."""
        if self.mission.name is not StateName.IDLE:
            self._command("cancel", now, f"cancelled by the operator while {self.mission.doing}")

    def stand_at(self, environment: str, vertex: VertexId) -> None:
        """Takes the operator's word for where the robot stands."""
        self.check("position")
        self.mission = replace(self.mission, environment=environment, position=vertex)

    def check(self, command: str) -> None:
        """Refuses a command that the present state does not allow, and changes nothing.

        Raises:
            MissionRefused: with the state in its sentence.
        """
        mission = self.mission
        allowed = (
            mission.name is StateName.IDLE
            if command == "position"
            else self._hierarchy.may(command, target_known=mission.target is not None, resumes=mission.resumes)
        )
        if not allowed:
            raise MissionRefused(_REFUSALS[command].format(doing=mission.doing))

    # --- events ------------------------------------------------------------------------------------------------------

    def planned(
        self, now: float, attempt: int, route: str, target: VertexId, reason: str, recorded: MapRecord | None = None
    ) -> bool:
        """Takes a route, whose first vertex is the target; returns False if nobody waits for it any longer.

        With ``recorded``, the record of the map that is repeated, the repeat records a map of its own.
        """
        if attempt != self.mission.attempt:
            return False
        record = None if recorded is None else self._new_map(self.mission.environment, recorded)
        return self._event("planned", now, reason, route=route, target=target, map=record)

    def not_planned(self, now: float, attempt: int, reason: str) -> bool:
        """Takes the planner's refusal."""
        return attempt == self.mission.attempt and self._event("not_planned", now, reason)

    def localized(self, now: float, route: str, trunk: VertexId) -> None:
        """Takes a successful localization on a route, or, with an empty one, against the target of a teach."""
        mission = self.mission
        if route != mission.route:
            return
        if mission.name is StateName.REPEAT_FOLLOW:
            self.mission = replace(mission, position=trunk)
        elif mission.name is not StateName.TEACH_METRIC_LOCALIZE or trunk == mission.target:
            self._event("localized", now, f"localized against {trunk}", position=trunk)

    def made_vertex(self, vertex: VertexId) -> None:
        """Takes the last vertex of the map that is being taught, where the robot stands then."""
        mission = self.mission
        if mission.name is StateName.TEACH_BRANCH and mission.map is not None and vertex.map_id == mission.map.id:
            self.mission = replace(mission, position=vertex)

    def arrived(self, now: float, route: str) -> None:
        """Takes the tracker's word that the robot stands at the end of a route."""
        if route == self.mission.route:
            self._event("arrived", now, f"reached {self.mission.goal}")

    def lost(self, now: float, reason: str) -> None:
        """Pauses what needs the process or the data that was lost."""
        self._event("lost", now, reason)

    def tick(self, now: float) -> None:
        """Ends a state that has waited for longer than its deadline."""
        mission = self.mission
        limit = self._limits.get(mission.name, float("inf"))
        if now - mission.since > limit:
            awaited = mission.waiting_for
            self._event("timed_out", now, f"gave up {mission.doing}: waited {limit:g} s for {awaited}")

    # --- what both have in common ------------------------------------------------------------------------------------

    def _command(self, event: str, now: float, reason: str, **changes: object) -> None:
        if not self._event(event, now, reason, **changes):
            raise MissionRefused(_REFUSALS[event].format(doing=self.mission.doing))

    def _event(self, event: str, now: float, reason: str, **changes: object) -> bool:
        """Moves the hierarchy, and the mission with it, to the state that the event leads to, if to any."""
        before = self.mission
        wanted = replace(before, **changes)  # type: ignore[arg-type]
        known = wanted.target is not None
        if not self._hierarchy.fire(event, target_known=known, resumes=before.resumes):
            return False
        entered = self._hierarchy.state
        if entered is StateName.PAUSED and before.name is StateName.PAUSED:
            self.mission = replace(wanted, resumes=StateName.REPEAT_METRIC_LOCALIZE)
        else:
            self.mission = self._entered(replace(wanted, name=entered, since=now, reason=reason), before)
        return True

    def _entered(self, mission: Mission, before: Mission) -> Mission:
        """The mission with what belongs to the state just entered, and nothing left over from the last one."""
        match mission.name:
            case StateName.IDLE:
                return Mission(StateName.IDLE, mission.since, mission.reason, mission.environment, mission.position)
            case StateName.PAUSED:
                return replace(mission, resumes=before.name)
            case StateName.TEACH_BRANCH if mission.map is None:
                return replace(mission, resumes=None, map=self._new_map(mission.environment, None))
            case StateName.REPEAT_METRIC_LOCALIZE if before.name is StateName.PAUSED:
                return replace(mission, resumes=None, target=self._target_of_resuming(before))
            case _:
                return replace(mission, resumes=None)

    @staticmethod
    def _target_of_resuming(before: Mission) -> VertexId | None:
        """Where a paused repeat was localized last; the route's first vertex if it has not been yet."""
        return before.position if before.resumes is StateName.REPEAT_FOLLOW else before.target
