"""The obstacle watch as a process, and safety that heeds it."""

import time

import numpy as np
import pytest

from common import topics
from common.geometry import from_xy_yaw
from common.messages import LidarScan, Obstacles, StateName, Zone, now_ns
from tests.processes import Robot, eventually, every
from tests.services.safety.crew import Crew

BEAMS, COLUMNS = 16, 90
TABLES = '[obstacles]\nlidar = "top"\nperiod_s = 0.03\n[obstacles.zones]\npoints = 5\nclear_s = 0.2\n'


def scan(ahead, behind=20.0):
    """A wall all across the front half of the view, and another one behind."""
    azimuths = np.linspace(np.pi, -np.pi, COLUMNS, endpoint=False)
    wall = np.where(np.abs(azimuths) < 0.4, ahead, np.where(np.abs(azimuths) > np.pi - 0.4, behind, 20.0))
    T = from_xy_yaw(0, 0, 0)
    T[2, 3] = 0.8
    return LidarScan(
        stamp=now_ns(), T_vehicle_lidar=T, ranges=np.tile(wall, (BEAMS, 1)).astype(np.float32),
        intensities=np.full((BEAMS, COLUMNS), 9, np.uint8), elevations=np.linspace(0.1, -0.1, BEAMS),
        azimuths=azimuths, offsets=np.zeros(COLUMNS),
    )  # fmt: skip


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot"), TABLES) as robot:
        robot.start("obstacles")
        yield robot


@pytest.mark.parametrize(
    ("ahead", "behind", "zones"),
    [(1.0, 20.0, ("stop", "clear")), (2.5, 20.0, ("slow", "clear")), (9.0, 1.0, ("clear", "clear"))],
)
def test_it_tells_what_stands_in_which_zone(robot, ahead, behind, zones):
    scans = robot.bus("sensors").publisher(topics.LIDAR, "top")
    heard = robot.bus("observer").subscribe(topics.OBSTACLES)
    with every(0.03, lambda: scans.put(scan(ahead, behind))):
        begin = time.monotonic()
        found = eventually(
            lambda: (
                (m := heard.last())
                and m.arrival > begin
                and (m.message.ahead, m.message.behind) == tuple(map(Zone, zones))
                and m.message
            ),
            f"the zones are {zones}",
        )
    assert (found.nearest is None) == (zones == ("clear", "clear"))


def test_safety_stops_for_what_stands_where_a_command_leads(tmp_path):
    with Robot(tmp_path, TABLES) as robot:
        crew = Crew(robot)
        found = robot.act_as("obstacles").publisher(topics.OBSTACLES)
        robot.start("safety")
        zones = {"ahead": Zone.CLEAR, "behind": Zone.CLEAR}

        def publish():
            crew.publish()
            if zones:
                found.put(Obstacles(stamp=now_ns(), **zones))

        with every(0.03, publish), crew.state_is(StateName.REPEAT_FOLLOW):
            crew.until(lambda safe: safe.v > 0.3, "the robot drives")
            zones["ahead"] = Zone.STOP
            crew.until(lambda safe: safe.v == 0.0, "it stops")
            _, rules = crew.until_status(lambda status: not status.passing, "and says why")
            assert rules == {"obstacle"}
            crew.speed = -0.4
            crew.until(lambda safe: safe.v < -0.3, "it drives away backwards")
            zones["behind"] = Zone.STOP
            crew.until(lambda safe: safe.v == 0.0, "and stops for what is behind")
            zones.update(ahead=Zone.CLEAR, behind=Zone.CLEAR)
            crew.until(lambda safe: safe.v < -0.3, "it drives on")
            zones.clear()
            crew.until(lambda safe: safe.v == 0.0, "it stops where nobody watches any longer")
            _, rules = crew.until_status(lambda status: not status.passing, "and says why")
            assert rules == {"obstacles_stale"}
