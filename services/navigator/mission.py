"""What the robot is doing, and why: the data that the state machine moves on."""

from __future__ import annotations

from dataclasses import dataclass

from common.errors import RetraverseError
from common.ids import VertexId
from common.messages import Goal, LoopClosure, MapRecord, StateName


class MissionRefused(RetraverseError):
    """A command that the present state does not allow."""


@dataclass(frozen=True, slots=True)
class Deadlines:
    """Seconds that a waiting state may last before it is given up.

    ``recover`` is how long what was lost may be away; 0 where a pause always waits for the operator. ``merge`` is how
    long a loop closure is looked for, and ``confirm`` how long the one that is offered waits for the operator.
    """

    plan: float
    localize: float
    paused: float
    recover: float = 0.0
    merge: float = 60.0
    confirm: float = 120.0


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
        recovery: monotonic time (s) until which a pause may end by itself; 0 where it does not.
        rests: monotonic time (s) at which a pause between two goals ends by itself; 0 where it does not.
        target: the vertex to localize against.
        map: the map that is being taught, or recorded on the way of a repeat.
        start_place: the name that the map's first vertex will get.
        candidates: the vertices that the map may be merged at; ``closure`` the loop closure that is offered.
        goal: where a repeat goes.
        goals: where it goes after that.
        attempt: tells the plan that is waited for from the answer to an earlier question.
        awaited: what a plan itself waits for; and ``patience``, until when (monotonic, s) that is worth waiting for.
        route: id of the planned route; ``extends`` that of the shorter one which it goes on from.
        pauses_at: the vertex of the route at which the robot pauses.
    """

    name: StateName
    since: float
    reason: str
    environment: str
    position: VertexId | None = None
    resumes: StateName | None = None
    recovery: float = 0.0
    rests: float = 0.0
    target: VertexId | None = None
    map: MapRecord | None = None
    start_place: str | None = None
    candidates: tuple[VertexId, ...] = ()
    closure: LoopClosure | None = None
    goal: Goal | None = None
    goals: tuple[Goal, ...] = ()
    attempt: int = 0
    awaited: str = ""
    patience: float = 0.0
    route: str = ""
    extends: str = ""
    pauses_at: VertexId | None = None

    @property
    def doing(self) -> str:
        """The state within a sentence."""
        return f"paused in {self.resumes}" if self.name is StateName.PAUSED else f"in {self.name}"

    @property
    def destination(self) -> str:
        """The goal in the operator's words; empty where there is none."""
        return "" if self.goal is None else self.goal.to

    @property
    def waiting_for(self) -> str:
        """What ends this state, where the robot waits for it."""
        match self.name:
            case StateName.TEACH_METRIC_LOCALIZE | StateName.REPEAT_METRIC_LOCALIZE:
                return f"a localization against {self.target}"
            case StateName.TEACH_BRANCH:
                return "the operator, who drives and then finishes the map"
            case StateName.TEACH_MERGE:
                return self._waiting_in_a_merge()
            case StateName.REPEAT_PLAN:
                return f"a plan to {self.destination}" + (f": {self.awaited}" if self.awaited else "")
            case StateName.PAUSED:
                return self._waiting_in_a_pause()
            case _:
                return ""

    def _waiting_in_a_merge(self) -> str:
        if self.closure is None:
            return f"a localization against one of {len(self.candidates)} candidates"
        return f"the operator, who confirms that the map meets {self.closure.edge.b}, or rejects it"

    def _waiting_in_a_pause(self) -> str:
        if self.rests:
            return f"the end of the rest before {self.destination}"
        return "what was lost, to go on" if self.recovery else "the operator, who resumes or cancels"
