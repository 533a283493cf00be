"""The state machine: commands, which may be refused, and events, which may mean nothing now. Knows no bus, no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from common.ids import VertexId
from common.messages import Goal, LoopClosure, MapRecord, StateName
from services.navigator.hierarchy import Hierarchy
from services.navigator.mission import Deadlines, Mission, MissionRefused

_REFUSALS: Mapping[str, str] = {
    "teach": "a map can be taught from Idle only, and the robot is {doing}: finish or cancel that first",
    "repeat": "a repeat starts from Idle only, and the robot is {doing}: finish or cancel that first",
    "finish": "no map is being taught that could be finished: the robot is {doing}",
    "merge": "a map can be merged only while it is taught, and the robot is {doing}",
    "confirm": "there is no loop closure to confirm: the robot is {doing}",
    "reject": "there is no loop closure to reject: the robot is {doing}",
    "branch": "no merge is under way that could be left: the robot is {doing}",
    "append": "a goal can be appended to a repeat only, and the robot is {doing}",
    "swap": "the goal of a repeat only can be swapped, and the robot is {doing}",
    "drop": "there is no such goal that waits: the robot is {doing}",
    "pause": "there is nothing to pause: the robot is {doing}",
    "pause_ahead": "the robot pauses at a vertex ahead only while it follows a route, and it is {doing}",
    "resume": "there is nothing to resume: the robot is {doing}, not paused",
    "position": "the robot's position can be set in Idle or in a repeat only, and the robot is {doing}",
}
_STAYS = {"merge", "offered", "reject", "append", "extended", "pause_ahead"}
"""Events that may leave the state as it is, and change something about it."""


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
        unfinished: Mission | None = None,
    ) -> None:
        """Starts in Idle or, with an ``unfinished`` mission, in that pause.

        ``new_map`` makes the record of a map of an environment: of a taught one or, with the record of the map that is
        repeated, of one recorded on the way.
        """
        self.mission = unfinished or Mission(StateName.IDLE, now, "started", environment, position)
        self._hierarchy = Hierarchy(self.mission)
        self._new_map = new_map
        self._deadlines = deadlines
        self._attempts = 0

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

    def merge(self, now: float, candidates: tuple[VertexId, ...]) -> None:
        """Looks for a loop closure between the map that is being taught and these vertices."""
        self._command("merge", now, "the map is to be merged", candidates=candidates, closure=None)

    def confirm(self, now: float) -> Mission:
        """Ends the map that is being taught with the loop closure that is offered; returns the mission that was."""
        before = self.mission
        met = "" if before.closure is None else f", which meets {before.closure.edge.b}"
        self._command("confirm", now, f"finished map {before.map.id if before.map else ''}{met}")
        return before

    def reject(self, now: float) -> None:
        """Refuses the loop closure that is offered, and its candidate with it; the others are tried on."""
        closure = self.mission.closure
        wrong = None if closure is None else closure.edge.b
        left = tuple(vertex for vertex in self.mission.candidates if vertex != wrong)
        self._command(
            "reject", now, f"the operator says that the map does not meet {wrong}", candidates=left, closure=None
        )

    def branch(self, now: float) -> None:
        """Goes on teaching without a loop closure."""
        self._command("branch", now, "the map is taught on without a merge")

    def repeat(self, now: float, environment: str, start: VertexId | None, goal: Goal) -> int:
        """Waits for a route from a vertex, or from a place, to a goal; returns the attempt to name with its answer.

        A goal before which the robot rests is planned afterwards: the attempt then is 0.
        """
        rests = now + goal.pause_before if goal.pause_before else 0.0
        attempt = 0 if rests else self._next_attempt()
        changes = {"environment": environment, "position": start, "goal": goal, "attempt": attempt, "rests": rests}
        self._command("repeat", now, f"the operator sends the robot to {goal.to}", **changes)
        return attempt

    def append(self, now: float, goal: Goal) -> None:
        """Puts a goal behind those that are driven to."""
        self._command("append", now, self.mission.reason, goals=(*self.mission.goals, goal))

    def swap(self, now: float, goal: Goal, reason: str) -> int:
        """Plans anew, to a goal in place of the present one; returns the attempt to name with its answer."""
        attempt = self._next_attempt()
        self._command("swap", now, reason, **_planless(goal, attempt))
        return attempt

    def drop(self, number: int) -> Goal:
        """Takes a goal away that waits, counted from 1."""
        goals = self._waiting(number)
        self.mission = replace(self.mission, goals=goals[: number - 1] + goals[number:])
        return goals[number - 1]

    def move(self, number: int, to: int) -> Goal:
        """Puts a goal that waits in another place of the queue; both are counted from 1."""
        goals = list(self._waiting(number, to))
        moved = goals.pop(number - 1)
        goals.insert(to - 1, moved)
        self.mission = replace(self.mission, goals=tuple(goals))
        return moved

    def pause(self, now: float) -> None:
        """Stops the robot and keeps what it was doing."""
        self._command("pause", now, "paused by the operator")

    def pause_ahead(self, now: float, vertex: VertexId) -> None:
        """Lets the robot drive on to a vertex of its route, and pauses there."""
        self._command("pause_ahead", now, self.mission.reason, pauses_at=vertex)

    def resume(self, now: float) -> None:
        """Goes on with what a pause holds; a repeat is localized anew, against the vertex of the last localization."""
        self._command("resume", now, "resumed by the operator")

    def cancel(self, now: float) -> None:
        """Ends in Idle whatever it was doing; a map that is being taught stays as it stands."""
        if self.mission.name is not StateName.IDLE:
            self._command("cancel", now, f"cancelled by the operator while {self.mission.doing}")

    def stand_at(self, environment: str, vertex: VertexId) -> None:
        """Takes the word of the operator, or of the estimator, for where the robot stands."""
        self.check("position")
        self.mission = replace(self.mission, environment=environment, position=vertex)

    def check(self, command: str) -> None:
        """Refuses a command that the present state does not allow, and changes nothing.

        Raises:
            MissionRefused: with the state in its sentence.
        """
        mission = self.mission
        allowed = self._hierarchy.may("swap" if command == "position" else command, mission)
        if not (allowed or (command == "position" and mission.name is StateName.IDLE)):
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

    def plans_anew(self) -> int | None:
        """The attempt to name with a plan's answer, for a repeat that waits for a plan that nobody was asked for."""
        mission = self.mission
        if mission.name is not StateName.REPEAT_PLAN or mission.attempt:
            return None
        self.mission = replace(mission, attempt=self._next_attempt())
        return self.mission.attempt

    def fetching(self, attempt: int, awaited: str, patience: float) -> bool:
        """The plan waits for something itself, and is worth waiting for until ``patience`` (monotonic, s)."""
        mission = self.mission
        if attempt != mission.attempt or StateName.REPEAT_PLAN not in {mission.name, mission.resumes}:
            return False
        self.mission = replace(mission, awaited=awaited, patience=patience)
        return True

    def extended(self, now: float, route: str, longer: str) -> bool:
        """Goes on over a longer route that begins as the present one, without a stop."""
        return route == self.mission.route and self._event(
            "extended", now, self.mission.reason, route=longer, extends=route
        )

    def goes_on(self, now: float, route: str, following: str, target: VertexId, reason: str) -> bool:
        """At a route's end, finds itself on the first vertex of the next one."""
        return route == self.mission.route and self._event("goes_on", now, reason, route=following, target=target)

    def records(self, record: MapRecord) -> None:
        """Goes on recording in another map, for it follows another one."""
        if self.mission.map is not None and self.mission.name is StateName.REPEAT_FOLLOW:
            self.mission = replace(self.mission, map=record)

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
        teaching = mission.name in {StateName.TEACH_BRANCH, StateName.TEACH_MERGE}
        if teaching and mission.map is not None and vertex.map_id == mission.map.id:
            self.mission = replace(mission, position=vertex)

    def offered(self, now: float, closure: LoopClosure) -> None:
        """Takes a loop closure for the operator to confirm; it stays until that is done."""
        mission = self.mission
        a, b = closure.edge.a, closure.edge.b
        if mission.map is not None and a.map_id == mission.map.id and b in mission.candidates:
            reason = f"the map seems to meet {b}: {closure.inliers} landmarks agree"
            self._event("offered", now, reason, closure=closure)

    def arrived(self, now: float, route: str) -> None:
        """Takes the tracker's word that the robot stands at the end of a route, or where it is to pause."""
        mission = self.mission
        if route != mission.route or mission.name is not StateName.REPEAT_FOLLOW:
            return
        if mission.pauses_at is not None:
            self._event("pause", now, f"paused by the operator at {mission.pauses_at}")
            return
        reason = f"reached {mission.destination}"
        if not mission.goals:
            self._event("arrived", now, reason)
            return
        following, *others = mission.goals
        rest = following.pause_before + (0.0 if mission.goal is None else mission.goal.pause_after)
        changes = {**_planless(following, 0), "goals": tuple(others), "rests": now + rest if rest else 0.0}
        self._event("arrived", now, f"{reason}, and goes on to {following.to}", **changes)

    def lost(self, now: float, reason: str, *, may_recover: bool = True) -> None:
        """Pauses what needs the process or the data that was lost, until that is back, or the operator resumes."""
        recover = self._deadlines.recover
        recovery = now + recover if may_recover and recover else 0.0
        self._event("lost", now, reason, recovery=recovery)

    def recovered(self, now: float) -> None:
        """What was lost is back: the mission goes on, a repeat by localizing anew."""
        mission = self.mission
        if mission.recovery:
            self._event("resume", now, f"goes on, after: {mission.reason}")

    def hold(self, reason: str) -> None:
        """A pause that would have ended by itself waits for the operator."""
        mission = self.mission
        if mission.recovery or mission.rests:
            self.mission = replace(mission, recovery=0.0, rests=0.0, reason=f"{reason}, after: {mission.reason}")

    def tick(self, now: float) -> None:
        """Ends a state that has waited for longer than its deadline, and a rest that is over."""
        mission = self.mission
        limit = self._limit(mission)
        if mission.rests:
            if now >= mission.rests:
                self._event("resume", now, f"has rested, and goes on to {mission.destination}")
        elif mission.recovery and now > mission.recovery:
            self._event("timed_out", now, f"gave up {mission.doing}: {mission.reason}, and not back in time")
        elif now - mission.since > limit and now > mission.patience:
            awaited = mission.waiting_for
            self._event("timed_out", now, f"gave up {mission.doing}: waited {limit:g} s for {awaited}")

    # --- what both have in common ------------------------------------------------------------------------------------

    def _waiting(self, *numbers: int) -> tuple[Goal, ...]:
        """The goals that wait, if there are some of these numbers."""
        goals = self.mission.goals
        if not all(1 <= number <= len(goals) for number in numbers):
            raise MissionRefused(
                _REFUSALS["drop"].format(doing=self.mission.doing) + f" with {len(goals)} waiting goals"
            )
        return goals

    def _next_attempt(self) -> int:
        self._attempts += 1
        return self._attempts

    def _limit(self, mission: Mission) -> float:
        """Seconds that the state may last."""
        deadlines = self._deadlines
        match mission.name:
            case StateName.TEACH_METRIC_LOCALIZE | StateName.REPEAT_METRIC_LOCALIZE:
                return deadlines.localize
            case StateName.TEACH_MERGE:
                return deadlines.merge if mission.closure is None else deadlines.confirm
            case StateName.REPEAT_PLAN:
                return deadlines.plan
            case StateName.PAUSED:
                return deadlines.paused
            case _:
                return float("inf")

    def _command(self, event: str, now: float, reason: str, **changes: object) -> None:
        if not self._event(event, now, reason, **changes):
            raise MissionRefused(_REFUSALS[event].format(doing=self.mission.doing))

    def _event(self, event: str, now: float, reason: str, **changes: object) -> bool:
        """Moves the hierarchy, and the mission with it, to the state that the event leads to, if to any."""
        before = self.mission
        wanted = replace(before, **changes)  # type: ignore[arg-type]
        if not self._hierarchy.fire(event, before, wanted):
            return False
        entered = self._hierarchy.state
        if event == "pause" and before.name is StateName.PAUSED:
            self.hold(reason)
        elif event == "planned" and before.name is StateName.PAUSED:
            self.mission = replace(wanted, resumes=StateName.REPEAT_METRIC_LOCALIZE)
        elif entered is before.name and event in _STAYS:
            # What a merge waits for is another thing from now on.
            since = now if entered is StateName.TEACH_MERGE else before.since
            self.mission = replace(wanted, reason=reason, since=since)
        else:
            self.mission = self._entered(replace(wanted, name=entered, since=now, reason=reason), before)
        return True

    def _entered(self, mission: Mission, before: Mission) -> Mission:
        """The mission with what belongs to the state just entered, and nothing left over from the last one."""
        if mission.name is StateName.PAUSED:
            resumes = StateName.REPEAT_PLAN if mission.rests else before.name
            return replace(mission, extends="", resumes=resumes, closure=None, pauses_at=None)
        mission = replace(mission, extends="", recovery=0.0, rests=0.0, resumes=None, pauses_at=None)
        match mission.name:
            case StateName.IDLE:
                return Mission(StateName.IDLE, mission.since, mission.reason, mission.environment, mission.position)
            case StateName.TEACH_BRANCH:
                record = mission.map or self._new_map(mission.environment, None)
                return replace(mission, map=record, candidates=(), closure=None)
            case StateName.REPEAT_METRIC_LOCALIZE if before.name is StateName.PAUSED:
                return replace(mission, target=self._target_of_resuming(before))
            case _:
                return mission

    @staticmethod
    def _target_of_resuming(before: Mission) -> VertexId | None:
        """Where a paused repeat was localized last; the route's first vertex if it has not been yet."""
        return before.position if before.resumes is StateName.REPEAT_FOLLOW else before.target


def _planless(goal: Goal, attempt: int) -> dict[str, object]:
    """A repeat that has a goal and no route yet."""
    return {
        "goal": goal,
        "attempt": attempt,
        "route": "",
        "target": None,
        "map": None,
        "awaited": "",
        "patience": 0.0,
    }
