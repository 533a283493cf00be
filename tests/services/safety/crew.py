"""The processes around safety, and all that they publish while they are well."""

import contextlib

import numpy as np

from common import topics
from common.ids import VertexId, new_map_id
from common.messages import Localization, Odometry, SafetyCommand, State, StateName, VelocityCommand, now_ns
from tests.processes import Robot, eventually

START = VertexId(new_map_id("r1", 0), 0)
_MS = 1_000_000


class Crew:
    """The processes around safety, and all that they publish while they are well."""

    def __init__(self, robot: Robot):
        self.robot = robot
        self.state_name = StateName.IDLE
        self.speed, self.turn = 0.4, 0.1
        self.silent = False
        self.lags = False
        self._frame = 0
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
        route = "route1" if self.state_name is StateName.REPEAT_FOLLOW else ""
        self.state.put(
            State(stamp=stamp, name=self.state_name, environment="default", since=stamp, reason="", route=route)
        )
        self._frame = self._frame + _MS if self.lags else stamp
        pose = {"stamp": self._frame, "covariance": 1e-4 * np.eye(6), "success": True, "inliers": 100}
        self.odometry.put(Odometry(vertex=START, T_vertex_robot=np.eye(4), twist=np.zeros(6), **pose))
        self.localization.put(
            Localization(
                route="route1", trunk=START, trunk_index=0, T_trunk_robot=np.eye(4), stream="plain",
                metres_since_success=0, seconds_since_success=0, **pose,
            )
        )  # fmt: skip
        if not self.silent:
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
            self.state_name = StateName.IDLE
            self.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
            idle = "state_forbids"
            self.until_status(lambda status: idle in {reason.rule for reason in status.reasons}, "safety hears of it")

    @contextlib.contextmanager
    def silent_tracker(self):
        """The tracker is there and says nothing, and the robot has come to rest for that."""
        self.silent = True
        try:
            self.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
            yield
        finally:
            self.silent = False

    def stands(self, cycles=25):
        """Whether the next cycles all leave the robot at rest."""
        self.safe.last()
        seen = [self.safe.wait(5.0).message for _ in range(cycles)]
        return all((safe.v, safe.w, safe.frame_stamp) == (0.0, 0.0, 0) for safe in seen)
