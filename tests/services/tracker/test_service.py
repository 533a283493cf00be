"""The tracker as a process: when it commands, from what, and that it stops commanding."""

import dataclasses

import numpy as np
import pytest

from common import topics
from common.geometry import from_xy_yaw
from common.ids import VertexId, new_map_id
from common.messages import Localization, Route, State, StateName, WheelOdometry, now_ns
from tests.processes import Robot, eventually, every

MAP = new_map_id("r1", 0)
LENGTH = 10
S = StateName


@dataclasses.dataclass
class World:
    """What the processes around the tracker say."""

    state: StateName = S.IDLE
    route: str = "route1"
    since: int = 1
    localized_on: str = "route1"
    trunk: int = 2
    offset: float = 0.3
    speed: float = 0.0
    heading: float = 0.0
    actions: list | None = None


class Crew:
    def __init__(self, robot: Robot):
        self.robot = robot
        self.world = World()
        navigator, estimator, sensors = robot.act_as("navigator"), robot.act_as("estimator"), robot.act_as("sensors")
        operator = robot.bus("operator")
        self.states = navigator.publisher(topics.STATE)
        self.routes = navigator.publisher(topics.ROUTE)
        self.localizations = estimator.publisher(topics.LOCALIZATION)
        self.wheels = sensors.publisher(topics.WHEEL_ODOMETRY)
        self.desired = operator.subscribe(topics.DESIRED)
        self.status = operator.subscribe(topics.TRACKER_STATUS)

    def publish(self):
        world, stamp = self.world, now_ns()
        self.states.put(
            State(
                stamp=stamp, name=world.state, environment="default", since=world.since, reason="", route=world.route
            )
        )  # fmt: skip
        self.wheels.put(WheelOdometry(stamp=stamp, v=world.speed, w=0.0))
        self.localizations.put(
            Localization(
                stamp=stamp, route=world.localized_on, trunk=VertexId(MAP, world.trunk), trunk_index=world.trunk,
                T_trunk_robot=from_xy_yaw(0.0, world.offset, world.heading), covariance=1e-4 * np.eye(6),
                success=True, stream="plain", inliers=100, metres_since_success=0, seconds_since_success=0,
                metric=world.actions is None, actions=world.actions,
            )
        )  # fmt: skip

    def send_route(self, name, step=1.0, speed_limits=()):
        path = np.stack([from_xy_yaw(step * i, 0.0, 0.0) for i in range(LENGTH + 1)])
        vertices = [VertexId(MAP, i) for i in range(LENGTH + 1)]
        self.routes.put(
            Route(
                id=name, environment="default", goal="end", vertices=vertices, path=path, length=step * LENGTH,
                maps=[MAP], reason="the only map", speed_limits=list(speed_limits),
            )
        )  # fmt: skip

    def follow(self, route, **world):
        self.world = World(S.REPEAT_FOLLOW, route, now_ns(), **({"localized_on": route} | world))

    def until(self, holds, what):
        return eventually(lambda: (m := self.desired.last()) and holds(m.message) and m.message, what)

    def until_status(self, holds, what):
        return eventually(lambda: (m := self.status.last()) and holds(m.message) and m.message, what)


@pytest.fixture(scope="module")
def crew(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot")) as robot:
        crew = Crew(robot)
        robot.start("tracker")
        with every(0.03, crew.publish):
            yield crew


def test_it_commands_nothing_before_it_is_to_follow(crew):
    crew.until_status(lambda status: "Idle" in status.reason, "a status that names the state")
    assert crew.desired.last() is None


def test_it_steers_to_the_route_and_names_the_frame(crew):
    crew.send_route("route1")
    crew.follow("route1")
    command = crew.until(lambda command: command.v > 0.3 and command.w < -0.05, "forwards, and right to the path")
    assert 0 < command.frame_stamp < command.stamp
    status = crew.until_status(lambda status: status.route == "route1", "a status on the route")
    assert status.lateral_error == pytest.approx(0.3, abs=0.1)
    assert status.remaining == pytest.approx(8.0, abs=0.5)
    crew.world = World()
    crew.until_status(lambda status: status.route == "", "it no longer follows")
    while crew.desired.poll():
        pass
    assert crew.desired.wait(0.3) is None


def test_it_keeps_to_the_route_s_speed_limits(crew):
    crew.send_route("route7", speed_limits=[0.25] * (LENGTH + 1))
    crew.follow("route7", offset=0.0, speed=0.2)
    crew.until_status(lambda status: status.route == "route7", "a status on the route")
    commands = []
    crew.until(lambda command: commands.append(command.v) or command.v > 0.24, "it drives off")
    assert max(commands) <= 0.25 + 1e-9
    crew.send_route("route8", speed_limits=[1000.0] * (LENGTH + 1))
    crew.follow("route8", offset=0.0, speed=0.2)
    crew.until(lambda command: command.v > 0.3, "it drives faster where there is no limit")


def test_taught_actions_are_replayed_with_the_heading_corrected(crew):
    actions = [[metres, 0.4, 0.1] for metres in np.arange(-0.5, 2.0, 0.1)]
    crew.send_route("route6")
    crew.follow("route6", offset=0.7, heading=0.0, actions=actions)
    crew.until(lambda command: command.v == pytest.approx(0.4) and command.w == pytest.approx(0.1, abs=0.03), "replay")
    crew.world.heading = 0.2
    crew.until(lambda command: command.v == pytest.approx(0.4) and command.w < 0.06, "a turn back to the right")
    status = crew.until_status(lambda status: status.heading_error > 0.15, "its heading error")
    assert status.lateral_error == 0.0
    crew.world.actions = [[0.0, 0.0, 0.0]]
    crew.until(lambda command: command.v == command.w == 0.0, "it stands where nothing was taught")
    assert "no taught action" in crew.until_status(lambda status: "action" in status.reason, "a reason").reason


@pytest.mark.parametrize(
    ("world", "reason"),
    [
        ({"localized_on": "another"}, "no localization on this route"),
        ({"trunk": 99}, "99"),
    ],
)
def test_it_stands_with_a_reason_without_a_place_on_the_route(crew, world, reason):
    crew.send_route("route2")
    crew.follow("route2", **world)
    crew.until(lambda command: command.v == command.w == 0.0, "it stands")
    assert reason in crew.until_status(lambda status: reason in status.reason, "a reason").reason


@pytest.mark.parametrize("world", [{"localized_on": "another"}, {"trunk": 99}, {"offset": 1e6}])
def test_its_next_command_is_zero_where_a_localization_cannot_be_used(crew, world):
    name = f"route9-{next(iter(world))}"
    crew.send_route(name)
    crew.follow(name, trunk=1, offset=0.0)
    crew.until(lambda command: command.v > 0.6, "it drives fast")
    for field, value in world.items():
        setattr(crew.world, field, value)
    commands = []
    crew.until(lambda command: commands.append(command) or command.v == 0.0, "it stands")
    assert all(command.v > 0.5 for command in commands[:-1]), "safety shapes the stop, and nobody else"


def test_a_route_that_cannot_be_is_not_followed(crew):
    crew.send_route("route3", step=1e7)
    crew.follow("route3")
    crew.until_status(lambda status: "longest" in status.reason, "a reason")
    crew.until(lambda command: command.v == command.w == 0.0, "it stands")
    crew.send_route("route4")
    crew.follow("route4")
    crew.until(lambda command: command.v > 0.2, "it follows the next one")
    assert crew.robot.alive("tracker")


def test_it_finishes_at_the_end_and_can_follow_again(crew):
    crew.send_route("route5")
    crew.follow("route5", trunk=LENGTH, offset=0.0)
    assert crew.until_status(lambda status: status.finished, "it has arrived").remaining < 0.1
    crew.follow("route5", trunk=1, offset=0.0)
    crew.until(lambda command: command.v > 0.2, "a new stay on the same route begins anew")
    assert not crew.until_status(lambda status: not status.finished, "it is under way").finished
