"""A button can act exactly when the navigator takes its command."""

import itertools

import numpy as np
import pytest

from cli.processes import ROBOT
from common.geometry import from_xy_yaw
from common.ids import VertexId
from common.messages import EdgeRecord, Goal, LoopClosure, State, StateName
from services.console.robot.models import health
from services.console.robot.models.permits import Situation, refusals
from services.navigator.hierarchy import Hierarchy
from services.navigator.mission import Mission

HERE, THERE = VertexId("20261122T204500123456-r1-9f3c1a", 4), VertexId("20261122T204500123456-r1-9f3c1b", 2)
ALL = frozenset(process.name for process in ROBOT)
CLOSURE = LoopClosure(
    stamp=1, inliers=50,
    edge=EdgeRecord(kind="spatial", a=HERE, b=THERE, T_a_b=from_xy_yaw(0.0, 0.0, 0.0), covariance=np.eye(6)),
)  # fmt: skip
EVENTS = ("teach", "finish", "merge", "confirm", "reject", "branch", "repeat", "append", "swap", "pause",
          "pause_ahead", "resume", "cancel")  # fmt: skip


def missions():
    """Every state, and every state behind a pause, with and without a loop closure."""
    for name, resumes in itertools.product(StateName, [None, *StateName]):
        if (name is StateName.PAUSED) != (resumes is not None) or resumes in {StateName.IDLE, StateName.PAUSED}:
            continue
        closures = (None, CLOSURE) if name is StateName.TEACH_MERGE else (None,)
        for closure, recovery in itertools.product(closures, (0.0, 9.0) if resumes else (0.0,)):
            yield Mission(
                name, 0.0, "", "default", resumes=resumes, closure=closure, recovery=recovery, goal=Goal(to="gate"),
                candidates=(THERE,), target=HERE,
            )  # fmt: skip


def state_of(mission):
    return State(
        stamp=1, name=mission.name, environment="default", since=1, reason="", resumes=mission.resumes,
        closure=mission.closure, waiting_for=mission.waiting_for, goal="gate",
    )  # fmt: skip


@pytest.mark.parametrize("mission", list(missions()), ids=lambda mission: f"{mission.name}-{mission.resumes}")
def test_the_page_and_the_navigator_agree(mission):
    refused = refusals(Situation(state_of(mission), ALL, latched=False, taught=True))
    taken = {event: Hierarchy(mission).may(event, mission) for event in EVENTS}
    taken["cancel"] = mission.name is not StateName.IDLE
    assert {event: not refused[event] for event in EVENTS} == taken


def test_what_is_missing_is_named():
    state = state_of(Mission(StateName.IDLE, 0.0, "", "default"))
    assert "planner" in refusals(Situation(state, ALL - {"planner"}, latched=False, taught=True))["repeat"]
    assert "teach one" in refusals(Situation(state, ALL, latched=False, taught=False))["repeat"]
    assert "latched" in refusals(Situation(state, ALL, latched=True, taught=True))["teach"]
    assert "navigator" in refusals(Situation(None, ALL - {"navigator"}, latched=False, taught=True))["cancel"]
    assert refusals(Situation(None, frozenset(), latched=False, taught=True))["stop"]


def test_the_table_of_processes_is_the_robots():
    assert tuple(process.name for process in ROBOT) == health.PROCESSES
