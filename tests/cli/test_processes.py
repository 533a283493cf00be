"""The table of processes agrees with the services, the topics and the machine that it is meant for."""

import importlib.util
from dataclasses import is_dataclass

import pytest

from cli.processes import BUSY, ROBOT, named
from cli.robot import settings_kinds
from common import topics
from common.messages import StateName


def test_names_are_unique_and_found():
    assert [named(process.name) for process in ROBOT] == list(ROBOT)
    with pytest.raises(KeyError):
        named("nobody")


@pytest.mark.parametrize("process", ROBOT, ids=lambda process: process.name)
def test_every_row_is_a_service_that_can_be_started(process):
    assert importlib.util.find_spec(f"{process.module}.__main__") is not None
    assert is_dataclass(settings_kinds([process])[process.name])
    assert process.start_deadline_s > 0
    assert 0 < process.cpu < 1
    assert process.memory_mb > 0


def test_every_query_is_answered_by_a_process_of_the_table():
    names = {process.name for process in ROBOT}
    served = {owner for topic in topics.ALL if topic.delivery is topics.Delivery.QUERY for owner in topic.owners}
    assert served <= names


def test_the_budgets_fit_two_cores():
    assert sum(process.cpu for process in ROBOT) <= 2.0


def test_a_robot_at_rest_needs_nobody_and_a_busy_one_its_router_and_safety():
    assert all(StateName.IDLE not in process.critical for process in ROBOT)
    assert named("router").critical == named("safety").critical == BUSY
