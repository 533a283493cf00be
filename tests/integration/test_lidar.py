"""A lidar, in the loop: repeats in complete darkness, a robot that finds itself, and one that meets a wall."""

from datetime import UTC, datetime

import numpy as np
import pytest

from cli.daylight import Times
from cli.demo.errors import path_errors
from cli.demo.sensor import Sensor
from cli.demo.story import Offset
from common import topics
from common.ids import VertexId
from services.obstacles.zones import ZoneSettings
from services.sensors.world import World, WorldSettings
from tests.integration.whole_robot import WholeRobot

pytestmark = pytest.mark.long

SHORT_M = 11.0
NEAR_M, STOP_ZONE_M = 1.0, ZoneSettings().stop[1][0]
HEIGHTS_M = (0.4, 0.7, 1.0, 1.4)
MIDNIGHT = datetime(2026, 6, 21, 23, 30, tzinfo=UTC)


def test_a_lidar_repeats_in_darkness_finds_itself_and_stops_before_a_wall(tmp_path):
    with WholeRobot(tmp_path, Sensor.LIDAR, Times(MIDNIGHT, MIDNIGHT), '[obstacles]\nlidar = "top"\n') as robot:
        map_id, taught = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
        repeated = robot.story.repeat(taught.poses()[0], Offset(), taught.driven_metres(), 120.0, VertexId(map_id, 0))
        assert repeated.final_reason.startswith("reached"), repeated.final_reason
        assert repeated.localization_figures()["success"] > 0.95
        settled = np.abs(path_errors(taught.poses(), repeated.poses()).after(5.0).lateral)
        assert np.sqrt(np.mean(settled**2)) <= 0.05
        assert settled.max() <= 0.2
        assert np.linalg.norm(repeated.poses()[-1][:3, 3] - taught.poses()[-1][:3, 3]) <= 0.15
        robot.put_down(*robot.first_metres(SHORT_M / 2.0)[-1])
        robot.soon(lambda: robot.attempt("position", find=True), "the robot finds itself", 30.0)
        assert map_id in robot.command("position", find=True).text
        drives_up_to_a_wall_that_it_was_taught_to_come_near(robot)


def drives_up_to_a_wall_that_it_was_taught_to_come_near(robot):
    """A person may drive it as near as they like; by itself it stops where the wall enters the stop zone."""
    route, wall = way_to_a_wall(robot.route, NEAR_M)
    robot.calm()
    robot.forget_maps()
    robot.put_down(*route[0])
    map_id, _taught = robot.story.teach(route, robot.pace, ("front", "wall"))
    robot.put_down(*route[0])
    statuses = robot.bus.subscribe(topics.SAFETY_STATUS)
    robot.command("repeat", goal="wall", vertex=(map_id, 0), timeout=20.0)
    robot.soon(lambda: robot.speed() > 0.3, "it drives", 30.0)
    robot.soon(lambda: "obstacle" in rules(statuses) and not statuses.last().message.passing, "it is stopped", 60.0)
    robot.soon(lambda: robot.speed() == 0.0, "it stands", 5.0)
    left = np.linalg.norm(wall - robot.standing()[:2])
    assert NEAR_M + 0.15 < left < STOP_ZONE_M + 0.1
    robot.command("cancel")


def rules(statuses):
    """Why safety holds the robot."""
    return {reason.rule for reason in statuses.last().message.reasons}


def way_to_a_wall(route, near):
    """A straight way (N, 3) off the route that ends ``near`` metres before something wide, and where (2,) that is."""
    world = World(WorldSettings())
    for x, y, yaw in route[::10]:
        for heading in yaw + np.linspace(-np.pi, np.pi, 48, endpoint=False):
            ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
            beside = np.array([x, y]) + np.outer(np.linspace(-0.6, 0.6, 13), left)
            ground = world.scene.terrain.height(beside)
            origins = np.concatenate([np.column_stack([beside, ground + height]) for height in HEIGHTS_M])
            distance, _, _ = world.cast_rays(origins, np.tile([*ahead, 0.0], (len(origins), 1)))
            if distance.min() > 4.5 and distance.max() < 6.5 and np.ptp(distance) < 0.5:
                s = np.arange(0.0, distance.min() - near, 0.1)
                way = np.column_stack([[x, y] + s[:, None] * ahead, np.full(len(s), heading)])
                return way, np.array([x, y]) + distance[6] * ahead
    raise AssertionError("the world has no wall beside its route")
