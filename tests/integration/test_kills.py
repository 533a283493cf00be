"""``kill -9`` of every process in the middle of a teach and of a repeat."""

import time

import pytest

from cli.processes import ROBOT
from common.errors import BusError
from common.messages import StateName
from tests.integration.whole_robot import state_is

STANDSTILL_S = 0.5
MOVING_M_S = 0.8
SHORT_M = 15.0
NAMES = [process.name for process in ROBOT if process.name != "console"]
"""Its own test kills the console, and looks at the page meanwhile."""
NEEDED_IN_TEACH = {process.name for process in ROBOT if StateName.TEACH_BRANCH in process.critical}
NEEDED_IN_REPEAT = {process.name for process in ROBOT if StateName.REPEAT_FOLLOW in process.critical}


@pytest.fixture(scope="module")
def taught(robot):
    """A map of the first metres of the route, and the pose (x, y, yaw) where it begins."""
    start = robot.route[0]
    robot.calm()
    robot.forget_maps()
    robot.put_down(*start)
    robot.command("teach", start_place="start")
    human = robot.drive_by_hand(robot.first_metres(SHORT_M))
    assert human.arrived.wait(60)
    robot.soon(lambda: robot.speed() < 0.01, "the robot stands")
    robot.command("finish", end_place="end", timeout=30.0)
    human.stop()
    (map_id,) = robot.vertices()
    return map_id, start


@pytest.mark.parametrize("process", NAMES)
def test_in_a_repeat(robot, taught, process):
    map_id, start = taught
    robot.calm()
    robot.put_down(*start)
    before = robot.soon(lambda: stored(robot, "garden"), "the store answers", 30.0)
    robot.soon(lambda: robot.attempt("repeat", goal="end", vertex=(map_id, 0)), "the repeat is accepted", 60.0)
    robot.soon(lambda: robot.speed() > MOVING_M_S, "the robot moves", 30.0)
    killed, pid = robot.kill(process)
    if process in NEEDED_IN_REPEAT:
        if process != "sensors":  # whose death is that of the simulated world as well
            assert robot.seconds_to_standstill(killed) <= STANDSTILL_S
    else:
        time.sleep(0.6)
        assert robot.speed() > STANDSTILL_S
    robot.wait_back(process, pid)
    # Repeats record experiences of their own, which grow: what was there before must be there still.
    robot.soon(lambda: holds(stored(robot, "garden"), before), "every vertex is there", 10.0)
    if process not in NEEDED_IN_REPEAT:
        states = robot.states()
        robot.soon(lambda: state_is(states, "Idle"), "the goal is reached all the same", 60.0)
        assert states.last().message.reason.startswith("reached")


@pytest.mark.parametrize(
    "process", [pytest.param(name, marks=() if name in NEEDED_IN_TEACH else pytest.mark.long) for name in NAMES]
)
def test_in_a_teach(robot, taught, process):
    _, start = taught
    robot.calm()
    robot.put_down(*start)
    before = robot.soon(lambda: stored(robot, "garden"), "the store answers", 30.0)
    environment = f"kill-{process}"
    robot.soon(lambda: robot.attempt("teach", environment=environment), "the teach is accepted", 60.0)
    human = robot.drive_by_hand(robot.first_metres(SHORT_M))
    try:
        robot.soon(lambda: robot.speed() > MOVING_M_S, "the robot moves", 30.0)
        committed = committed_after(robot, environment, 4)
        killed, pid = robot.kill(process)
        if process in NEEDED_IN_TEACH and process != "sensors":
            assert robot.seconds_to_standstill(killed) <= STANDSTILL_S
        robot.wait_back(process, pid)
    finally:
        human.stop()
    after = robot.soon(lambda: stored(robot, environment), "the store answers", 20.0)
    for map_id, count in committed.items():
        assert after[map_id] >= count
    assert holds(robot.vertices(), before)


def holds(now, before):
    """Whether every vertex of before is there."""
    return now is not None and all(now.get(map_id, 0) >= count for map_id, count in before.items())


def stored(robot, environment):
    """Vertices by map of an environment; None while the store does not answer."""
    try:
        return robot.vertices(environment)
    except BusError:
        return None


def committed_after(robot, environment, least):
    """What is stored once at least so many vertices are."""
    return robot.soon(
        lambda: (found := stored(robot, environment)) and max(found.values(), default=0) >= least and found,
        "vertices are committed",
        30.0,
    )
