"""Plans, the navigator's state, and the operator's commands."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from common.arrays import Transforms
from common.ids import VertexId
from common.messages.base import Count, MapId, Message, Name, NotNegative, PlaceName, Stamp, Text, Weight
from common.messages.graph import EdgeRecord, MapRecord, Restriction

Mode = Literal["robust", "shortest", "explore"]
"""The thesis's modes (its section 3.4.3): presets of the weights theta."""
Weights = tuple[Weight, Weight, Weight]


class PlanRequest(Message):
    """From a vertex, or a place, to a place, a vertex (``map:index``), or a map's end (its id).

    ``mode`` or ``theta`` weigh the maps of the environment's model; as the planner is configured where neither is
    given. Where ``plan`` names the maps, they were chosen before, and the route only runs over them: as far as their
    joints are known now, and so never shorter than an earlier one from the same start.
    """

    environment: Name
    start: VertexId | None = None
    start_place: PlaceName | None = None
    goal: Text
    mode: Mode | None = None
    theta: Weights | None = None
    plan: Annotated[list[MapId], Field(max_length=1000)] = []

    @model_validator(mode="after")
    def _one_start(self) -> Self:
        if (self.start is None) == (self.start_place is None):
            raise ValueError("a plan starts at a vertex or at a place")
        return self


class Route(Message):
    """Vertices to follow, their poses ``T_first_vertex`` (N, 4, 4) in the first one's frame, and why these.

    ``maps`` are those of the vertices, in order. ``plan`` are the maps chosen for now to get to the goal: where it goes
    on after ``maps``, the route ends with them for as long as no edge joins their last vertex to ``next_map``, which
    the robot looks for on its way. A route over the same plan from the same start that goes further begins with the
    same vertices and poses: whoever follows the one follows the other without a stop. ``why`` has a sentence on each
    map of the plan. ``speed_limits`` (N,), in m/s, each hold on the stretch that begins at that vertex: a
    speed that no robot reaches where that stretch has no limit, and an empty list where none has.
    """

    id: Text
    environment: Name
    goal: Text
    vertices: list[VertexId]
    path: Transforms
    length: NotNegative
    maps: list[MapId]
    reason: Text
    plan: list[MapId] = []
    next_map: MapId | None = None
    why: list[Text] = []
    speed_limits: list[Annotated[float, Field(gt=0)]] = []

    @model_validator(mode="after")
    def _one_pose_a_vertex(self) -> Self:
        if len(self.vertices) != len(self.path) or not self.vertices:
            raise ValueError("a route has one pose for each of its vertices, and at least one")
        if self.speed_limits and len(self.speed_limits) != len(self.vertices):
            raise ValueError("a route has one speed limit for each of its vertices, or none at all")
        return self


class StateName(StrEnum):
    """The navigator's states (VT&R3); ``Paused`` keeps what was being done."""

    IDLE = "Idle"
    TEACH_METRIC_LOCALIZE = "Teach.MetricLocalize"
    TEACH_BRANCH = "Teach.Branch"
    TEACH_MERGE = "Teach.Merge"
    REPEAT_PLAN = "Repeat.Plan"
    REPEAT_METRIC_LOCALIZE = "Repeat.MetricLocalize"
    REPEAT_FOLLOW = "Repeat.Follow"
    PAUSED = "Paused"


class Goal(Message):
    """Where a repeat goes: a place, a map (its end) or a vertex (``map:index``), in the operator's words.

    ``pause_before`` and ``pause_after`` are seconds that the robot rests before it sets out and once it is there.
    ``mode`` or ``theta`` choose the maps, and ``record`` says whether an experience is recorded on the way (None: as
    the robot is configured).
    """

    to: Text
    pause_before: NotNegative = 0.0
    pause_after: NotNegative = 0.0
    mode: Mode | None = None
    theta: Weights | None = None
    record: bool | None = None


class LoopClosure(Message):
    """A way to join the map that is being taught to another, found by localizing a frame against a candidate vertex.

    ``edge`` leads from a vertex of the map to the candidate; two frames agree on it, and ``inliers`` landmarks of the
    second one.
    """

    stamp: Stamp
    edge: EdgeRecord
    inliers: Count


class State(Message):
    """What the robot is doing, why, and what it waits for; published on change and ten times a second.

    ``map`` is the map being taught, or recorded while a route is repeated; ``route`` the id of the route being
    followed, and ``extends`` that of the shorter one which it went on from without a stop; ``target`` the vertex to
    localize against; ``position`` the vertex last localized against; ``resumes`` the state behind a pause.
    ``candidates`` are the vertices that a map may be merged at, and ``closure`` the loop closure that the operator may
    confirm. ``goals`` wait behind ``goal``; ``pauses_at`` is the vertex of the route at which the robot will pause.
    """

    stamp: Stamp
    name: StateName
    environment: Name
    since: Stamp
    reason: Text
    waiting_for: Text = ""
    resumes: StateName | None = None
    map: MapRecord | None = None
    route: Text = ""
    extends: Text = ""
    target: VertexId | None = None
    position: VertexId | None = None
    goal: Text = ""
    goals: list[Goal] = []
    pauses_at: VertexId | None = None
    candidates: list[VertexId] = []
    closure: LoopClosure | None = None


class Command(Message):
    """An operator's command to the navigator.

    ``teach`` starts a map (from ``vertex`` if the environment has maps) and ``finish`` ends it, naming its ends
    ``start_place`` and ``end_place`` where given. ``merge`` looks for a loop closure with ``candidates`` while a map is
    taught; ``confirm`` accepts the one that is offered and finishes the map, ``reject`` refuses it, and ``branch`` goes
    on teaching without one.

    ``repeat`` drives to ``goal`` from where the robot knows it stands, or from ``vertex`` or ``start_place``;
    ``append`` puts a goal behind those that are being driven to, ``swap`` puts it in place of the present one, and
    ``drop`` takes the waiting goal of a ``number``, counted from 1, away, and ``move`` puts it where goal ``to`` waits.
    ``pause`` stops at once or, ``at_vertex``, at a vertex of the route ahead. ``position`` tells the robot which vertex
    it stands at or, with ``find``, has it look for itself; while it repeats, it then plans anew from there.
    ``restrict`` limits the speed on a stretch of a map, or blocks it.
    """

    action: Literal[
        "teach", "finish", "merge", "confirm", "reject", "branch",
        "repeat", "append", "swap", "drop", "move", "pause", "resume", "cancel", "position", "restrict",
    ]  # fmt: skip
    environment: Name | None = None
    goal: Goal | None = None
    vertex: VertexId | None = None
    start_place: PlaceName | None = None
    end_place: PlaceName | None = None
    candidates: Annotated[list[VertexId], Field(max_length=64)] = []
    number: Annotated[int, Field(ge=1, le=1000)] | None = None
    to: Annotated[int, Field(ge=1, le=1000)] | None = None
    at_vertex: bool = False
    find: bool = False
    restriction: Restriction | None = None


class SafetyCommand(Message):
    """An operator's command to safety itself: an emergency stop, or its reset, which starts no motion."""

    action: Literal["stop", "reset"]
    reason: Text = ""
