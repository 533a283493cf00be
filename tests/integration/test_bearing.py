"""One uncalibrated camera and the wheels, in the loop: from metres beside the start, with a pause on the way."""

import numpy as np
import pytest

from cli.demo.sensor import Sensor
from common.errors import BusError
from common.ids import VertexId
from tests.integration.whole_robot import STILL_M_S, WholeRobot, state_is

pytestmark = pytest.mark.long

SHORT_M = 13.0
AHEAD_M = 1.5
BESIDE_M = 0.2


@pytest.fixture(scope="module")
def bearing(tmp_path_factory):
    with WholeRobot(tmp_path_factory.mktemp("bearing"), Sensor.BEARING) as robot:
        yield robot


def test_a_bearing_map_is_repeated_from_beside_its_start_and_through_a_pause(bearing):
    robot = bearing
    robot.put_down(*robot.route[0])
    map_id, taught = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
    x, y, yaw = robot.first_metres(AHEAD_M)[-1]
    robot.put_down(x - BESIDE_M * np.sin(yaw), y + BESIDE_M * np.cos(yaw), yaw + 0.05)
    states = robot.states()
    robot.command("repeat", goal="end", vertex=VertexId(map_id, 0))
    robot.soon(lambda: robot.speed() > 0.5, "it drives")
    robot.command("pause")
    robot.soon(lambda: robot.speed() < STILL_M_S, "it stands")
    robot.command("resume")
    robot.soon(lambda: robot.speed() > 0.5, "it drives on")
    robot.soon(lambda: state_is(states, "Idle"), "the repeat ends", 90.0)
    assert states.last().message.reason.startswith("reached")
    gap = robot.standing()[:2] - taught.poses()[-1][:2, 3]
    assert np.linalg.norm(gap) < 0.5
    with pytest.raises(BusError, match="can only be repeated as it was taught"):
        robot.command("repeat", goal="start")
