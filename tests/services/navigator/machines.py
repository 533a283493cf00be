"""State machines in each of their states, for tests."""

import numpy as np

from common.ids import VertexId, new_map_id
from common.messages import EdgeRecord, Goal, LoopClosure, MapRecord, StateName
from services.navigator.machine import StateMachine
from services.navigator.mission import Deadlines, Mission

S = StateName
OLD = VertexId(new_map_id("r1", 0), 3)
START = VertexId(new_map_id("r1", 0), 0)


CANDIDATES = (OLD, START)
END, FAR = Goal(to="end"), Goal(to="far")
TAUGHT = MapRecord(id=OLD.map_id, environment="park", stamp=0, robot="r1", sensor="stereo")


def make_map(environment: str, repeated: MapRecord | None) -> MapRecord:
    return MapRecord(
        id=new_map_id("r1", 1), environment=environment, stamp=1, robot="r1", sensor="stereo",
        generation=0 if repeated is None else repeated.generation + 1, parent=repeated and repeated.id,
    )  # fmt: skip


def new_machine(unfinished: Mission | None = None) -> StateMachine:
    return StateMachine("park", None, Deadlines(plan=3, localize=20, paused=100), make_map, 0.0, unfinished)


def name(machine: StateMachine) -> StateName:
    return machine.mission.name


def branching(machine: StateMachine) -> StateMachine:
    machine.teach(1.0, "park", None)
    return machine


def planning(machine: StateMachine) -> StateMachine:
    machine.repeat(1.0, "park", START, END)
    return machine


def localizing(machine: StateMachine) -> StateMachine:
    planning(machine).planned(2.0, machine.mission.attempt, "route1", START, "one map")
    return machine


def following(machine: StateMachine) -> StateMachine:
    localizing(machine).localized(3.0, "route1", START)
    return machine


def joining(machine: StateMachine) -> StateMachine:
    machine.teach(1.0, "park", OLD)
    return machine


def paused(machine: StateMachine) -> StateMachine:
    following(machine).pause(4.0)
    return machine


def paused_teach(machine: StateMachine) -> StateMachine:
    branching(machine).pause(4.0)
    return machine


def merging(machine: StateMachine) -> StateMachine:
    branching(machine).merge(4.0, CANDIDATES)
    return machine


def offered(machine: StateMachine) -> StateMachine:
    """A machine to which a loop closure with the first candidate is offered."""
    offered_now(merging(machine), 5.0)
    return machine


def offered_now(machine: StateMachine, now: float, candidate: VertexId = CANDIDATES[0]) -> None:
    taught = OLD.map_id if machine.mission.map is None else machine.mission.map.id
    edge = EdgeRecord(kind="spatial", a=VertexId(taught, 4), b=candidate, T_a_b=np.eye(4), covariance=np.eye(6))
    machine.offered(now, LoopClosure(stamp=1, edge=edge, inliers=60))


REACH = {
    S.IDLE: lambda machine: machine,
    S.TEACH_METRIC_LOCALIZE: joining,
    S.TEACH_BRANCH: branching,
    S.TEACH_MERGE: merging,
    S.REPEAT_PLAN: planning,
    S.REPEAT_METRIC_LOCALIZE: localizing,
    S.REPEAT_FOLLOW: following,
    S.PAUSED: paused,
}
