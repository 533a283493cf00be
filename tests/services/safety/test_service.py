"""Safety as a process: its rate, what it lets through, and what ends neither it nor its stops."""

import contextlib
import time

import numpy as np
import pytest

from common import topics
from common.ids import VertexId, new_map_id
from common.messages import Localization, Odometry, SafetyCommand, State, StateName, VelocityCommand, now_ns
from tests.processes import Robot, eventually, every

START = VertexId(new_map_id("r1", 0), 0)
S = StateName


class Crew:
    """The processes around safety, and all that they publish while they are well."""

    def __init__(self, robot: Robot):
        self.robot = robot
        self.state_name = S.IDLE
        self.speed, self.turn = 0.4, 0.1
        navigator = robot.act_as("navigator")
        estimator, operator = robot.bus("estimator"), robot.bus("operator")
        robot.act_as("sensors")
        robot.stand_in("estimator")
        self.tracker = robot.act_as("tracker")
        self.operator = operator
        self.state = navigator.publisher(topics.STATE)
        self.odometry = estimator.publisher(topics.ODOMETRY)
        self.localization = estimator.publisher(topics.LOCALIZATION)
        self.desired = self.tracker.publisher(topics.DESIRED)
        self.teleop = operator.publisher(topics.TELEOP)
        self.safe = operator.subscribe(topics.SAFE)
        self.status = operator.subscribe(topics.SAFETY_STATUS)

    def publish(self):
        stamp = now_ns()
        route = "route1" if self.state_name is S.REPEAT_FOLLOW else ""
        self.state.put(
            State(stamp=stamp, name=self.state_name, environment="default", since=stamp, reason="", route=route)
        )
        pose = {"stamp": stamp, "covariance": 1e-4 * np.eye(6), "success": True, "inliers": 100}
        self.odometry.put(Odometry(vertex=START, T_vertex_robot=np.eye(4), twist=np.zeros(6), **pose))
        self.localization.put(
            Localization(
                route="route1", trunk=START, trunk_index=0, T_trunk_robot=np.eye(4), stream="plain",
                metres_since_success=0, seconds_since_success=0, **pose,
            )
        )  # fmt: skip
        self.desired.put(VelocityCommand(stamp=stamp, v=self.speed, w=self.turn, frame_stamp=77))
        self.teleop.put(VelocityCommand(stamp=stamp, v=-self.speed, w=0.0))

    def until(self, holds, what):
        return eventually(lambda: (m := self.safe.last()) and holds(m.message) and m.message, what)

    def until_status(self, holds, what):
        found = eventually(lambda: (m := self.status.last()) and holds(m.message) and m.message, what)
        return found, {reason.rule for reason in found.reasons}

    def command(self, action, reason=""):
        return self.operator.ask(topics.SAFETY_COMMAND, SafetyCommand(action=action, reason=reason)).text

    @contextlib.contextmanager
    def state_is(self, name):
        self.state_name = name
        try:
            yield
        finally:
            self.state_name = S.IDLE
            self.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")


@pytest.fixture(scope="module")
def crew(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot")) as robot:
        crew = Crew(robot)
        robot.start("safety")
        with every(0.03, crew.publish):
            yield crew


def test_it_commands_at_its_rate_even_to_stand(crew):
    crew.until(lambda safe: safe.v == 0.0, "the first command")
    count, begin = 0, time.monotonic()
    while count < 50:
        received = crew.safe.wait(5.0)
        assert received is not None
        assert (received.message.v, received.message.w, received.message.frame_stamp) == (0.0, 0.0, 0)
        count += 1
    assert 20 < count / (time.monotonic() - begin) < 60
    _, rules = crew.until_status(lambda status: not status.passing, "a status")
    assert rules == {"state_forbids"}


def test_the_trackers_command_passes_while_following_and_names_its_frame(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        safe = crew.until(lambda safe: safe.v == pytest.approx(0.4) and safe.w == pytest.approx(0.1), "full speed")
        assert safe.frame_stamp == 77
        crew.until_status(lambda status: status.passing and status.scale == 1.0, "a status that says so")


def test_the_operators_command_passes_while_a_map_is_taught(crew):
    with crew.state_is(S.TEACH_BRANCH):
        assert crew.until(lambda safe: safe.v == pytest.approx(-0.4), "the operator drives").frame_stamp == 0


@pytest.mark.parametrize("state", [S.PAUSED, S.REPEAT_PLAN, S.REPEAT_METRIC_LOCALIZE])
def test_nothing_passes_in_other_states(crew, state):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.state_name = state
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")


def test_a_killed_estimator_stops_the_robot_by_name(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.robot.kill("estimator")
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
        status, _ = crew.until_status(lambda status: not status.passing, "a status that says so")
        assert any("estimator" in reason.text for reason in status.reasons)
        crew.robot.stand_in("estimator")
        crew.until(lambda safe: safe.v > 0.3, "the robot drives again")


def test_an_emergency_stop_is_latched_beyond_the_death_of_safety_until_it_is_reset(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.command("stop", "a child on the path")
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
        crew.robot.kill("safety")
        killed = now_ns()
        crew.robot.start("safety")
        status, rules = crew.until_status(
            lambda status: status.stamp > killed and status.latched, "it is latched still"
        )
        assert "emergency_stop" in rules
        assert any("a child on the path" in reason.text for reason in status.reasons)
        crew.speed = crew.turn = 0.0
        crew.command("reset")
        crew.until_status(lambda status: status.passing, "it is reset")
        crew.speed, crew.turn = 0.4, 0.1
        crew.until(lambda safe: safe.v > 0.3, "the robot drives again")


def test_nonsense_on_its_topics_moves_nothing(crew):
    session = crew.tracker.session
    for topic in (topics.DESIRED, topics.STATE, topics.LOCALIZATION, topics.TELEOP, topics.SAFETY_COMMAND):
        for payload in (b"", b"VTR1", bytes(64), b"\xff" * 300):
            session.put(topic.at("r1"), payload)
            session.put(topic.at("r1"), payload, attachment=payload)
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "it passes what is sound")
    assert crew.robot.alive("safety")
