"""The configuration that the demo writes for each of its sensors."""

import pytest

from cli import robot
from cli.demo.configuration import write_config
from cli.demo.sensor import Sensor


@pytest.mark.parametrize(("sensor", "simulated"), [("stereo", "stereo"), ("lidar", "lidar"), ("bearing", "camera")])
def test_the_world_simulates_what_the_robot_drives_by(tmp_path, sensor, simulated):
    path = tmp_path / "robot.toml"
    write_config(path, tmp_path / "data", None, Sensor(sensor))
    loaded = robot.load(path)
    robot.check(loaded)
    assert loaded.robot.sensor == sensor
    assert loaded.settings("sensors", robot.settings_kinds()["sensors"]).simulate == (simulated,)
