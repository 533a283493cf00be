"""Teach and repeat by each of the other sensors: a lidar in complete darkness, and one camera's bearing."""

from datetime import UTC, datetime

import numpy as np
import pytest

from cli.daylight import Times
from cli.demo.errors import path_errors
from cli.demo.sensor import Sensor
from cli.demo.story import Offset
from common.errors import BusError
from tests.integration.whole_robot import WholeRobot

SHORT_M = 14.0
MIDNIGHT = datetime(2026, 6, 21, 23, 30, tzinfo=UTC)


def teach_and_repeat(robot, offset):
    """Errors of a short repeat, the map's id, and what was recorded of the repeat."""
    map_id, taught = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
    repeated = robot.story.repeat(map_id, taught.poses()[0], offset, timeout=120.0)
    assert repeated.final_state == "Idle", repeated.final_reason
    assert repeated.final_reason.startswith("reached")
    assert np.linalg.norm(repeated.poses()[-1][:3, 3] - taught.poses()[-1][:3, 3]) <= 0.5
    assert repeated.localization_figures()["success"] > 0.95
    return path_errors(taught.poses(), repeated.poses()), map_id


def test_a_lidar_repeats_in_darkness_and_finds_itself(tmp_path):
    with WholeRobot(tmp_path, Sensor.LIDAR, Times(MIDNIGHT, MIDNIGHT)) as robot:
        errors, map_id = teach_and_repeat(robot, Offset())
        settled = np.abs(errors.after(5.0).lateral)
        assert np.sqrt(np.mean(settled**2)) <= 0.05
        assert settled.max() <= 0.2
        robot.put_down(*robot.first_metres(SHORT_M / 2.0)[-1])
        robot.soon(lambda: robot.attempt("position", find=True), "the robot finds itself", 30.0)
        assert map_id in robot.command("position", find=True).text


def test_a_camera_without_calibration_repeats_what_was_commanded(tmp_path):
    with WholeRobot(tmp_path, Sensor.BEARING) as robot:
        errors, map_id = teach_and_repeat(robot, Offset(0.3, 5.0))
        lateral = np.abs(errors.lateral)
        assert lateral.max() <= 0.8
        assert lateral[-1] <= 0.3
        with pytest.raises(BusError, match="can only be repeated as it was taught"):
            robot.command("repeat", goal=f"{map_id}:0")
