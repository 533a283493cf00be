"""A lidar, in the loop: teach and repeat in complete darkness, and a robot that finds itself."""

from datetime import UTC, datetime

import numpy as np

from cli.daylight import Times
from cli.demo.errors import path_errors
from cli.demo.sensor import Sensor
from cli.demo.story import Offset
from tests.integration.whole_robot import WholeRobot

SHORT_M = 14.0
MIDNIGHT = datetime(2026, 6, 21, 23, 30, tzinfo=UTC)


def test_a_lidar_repeats_in_darkness_and_finds_itself(tmp_path):
    with WholeRobot(tmp_path, Sensor.LIDAR, Times(MIDNIGHT, MIDNIGHT)) as robot:
        map_id, taught = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
        repeated = robot.story.repeat(map_id, taught.poses()[0], Offset(), timeout=120.0)
        assert repeated.final_reason.startswith("reached"), repeated.final_reason
        assert repeated.localization_figures()["success"] > 0.95
        settled = np.abs(path_errors(taught.poses(), repeated.poses()).after(5.0).lateral)
        assert np.sqrt(np.mean(settled**2)) <= 0.05
        assert settled.max() <= 0.2
        assert np.linalg.norm(repeated.poses()[-1][:3, 3] - taught.poses()[-1][:3, 3]) <= 0.15
        robot.put_down(*robot.first_metres(SHORT_M / 2.0)[-1])
        robot.soon(lambda: robot.attempt("position", find=True), "the robot finds itself", 30.0)
        assert map_id in robot.command("position", find=True).text
