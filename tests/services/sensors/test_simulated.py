"""The synthetic driver's other sensors as a process: only what is asked for is published, and it fits the truth."""

import numpy as np
import pytest

from common import topics
from common.messages import VelocityCommand, now_ns
from services.sensors.settings import Settings
from services.sensors.world import LidarSettings, SceneSettings, World, WorldSettings
from tests.processes import Robot, eventually, every

NIGHT = "2026-06-21T23:00:00Z"
SCENE = SceneSettings(extent=64.0, trees=4, bushes=2, boxes=4, stones=5, tufts=5, houses=1, walls=2, fences=1)
TABLES = f"""
[sensors]
simulate = ["SENSOR"]
[sensors.world]
time = {NIGHT}
[sensors.world.lidar]
beams = 16
[sensors.world.scene]
extent = 64.0
trees = 4
bushes = 2
boxes = 4
stones = 5
tufts = 5
houses = 1
walls = 2
fences = 1
"""


def tables(sensor):
    return TABLES.replace("SENSOR", sensor)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("lidar"), tables("lidar")) as running:
        running.start("sensors")
        yield running


def turning(robot, seconds):
    """The scans and the truth, each in order, of a robot that turns at 0.8 rad/s and drives at 0.5 m/s."""
    safety, operator = robot.act_as("safety"), robot.bus("operator")
    scans, truth = operator.subscribe(topics.LIDAR, "top"), operator.subscribe(topics.TRUTH)
    others = [operator.subscribe(topic, "front") for topic in (topics.STEREO, topics.CAMERA)]
    safe = safety.publisher(topics.SAFE)
    heard = ([], [])

    def listen():
        for subscription, into in zip((scans, truth), heard, strict=True):
            while (received := subscription.poll()) is not None:
                into.append(received.message)
        return len(heard[0]) > 1 and heard[0][-1].stamp - heard[0][0].stamp > seconds * 1e9

    with every(0.05, lambda: safe.put(VelocityCommand(stamp=now_ns(), v=0.5, w=0.8))):
        eventually(listen, "scans", 60.0)
    assert not [other for other in others if other.poll() is not None]
    return heard


def test_scans_arrive_by_night_and_lie_on_the_scene_when_the_true_motion_is_taken_out(robot):
    scans, truth = turning(robot, 2.5)
    stamps = np.array([scan.stamp for scan in scans])
    assert (np.diff(stamps) > 0).all()
    assert np.median(np.diff(stamps)) / 1e9 == pytest.approx(0.1, rel=0.5)
    world = World(WorldSettings(scene=SCENE, lidar=LidarSettings(beams=16)))
    clock = np.array([t.stamp for t in truth])
    poses = np.array([t.T_world_vehicle for t in truth])
    yaw = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    assert np.ptp(yaw) > 0.5
    off = []
    for scan in scans:
        at = scan.stamp + scan.offsets * 1e9
        if at[0] < clock[0] or at[-1] > clock[-1]:
            continue
        x, y, heading = (np.interp(at, clock, values) for values in (*poses[:, :2, 3].T, yaw))
        T = world.scene.terrain.standing(x, y, heading) @ scan.T_vehicle_lidar
        off.append(off_the_scene(world, scan, T))
    assert len(off) > 10
    # A stamp that is wrong by a tenth of a second would put a wall at 5 m off by 40 cm.
    assert np.median(off) < 0.03


def off_the_scene(world, scan, T):
    """The 80th percentile of how far points are from the surface that the true pose of their column sees there."""
    azimuth, elevation = scan.azimuths[:, None], scan.elevations[None, :]
    flat = np.cos(elevation)
    rays = np.stack([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation) + 0.0 * azimuth], axis=-1)
    directions = (rays @ np.swapaxes(T[:, :3, :3], -1, -2)).reshape(-1, 3)
    ranges, _, _ = world.cast_rays(np.repeat(T[:, :3, 3], len(scan.elevations), axis=0), directions)
    measured = scan.ranges.T.reshape(-1)
    seen = (measured > 0.0) & (measured < 15.0)
    assert seen.mean() > 0.2
    return float(np.quantile(np.abs(ranges - measured)[seen], 0.8))


def test_the_night_is_dark_for_a_camera_that_is_alone(tmp_path):
    with Robot(tmp_path, tables("camera")) as robot:
        robot.start("sensors")
        operator = robot.bus("operator")
        images = operator.subscribe(topics.CAMERA, "front")
        others = [operator.subscribe(topics.STEREO, "front"), operator.subscribe(topics.LIDAR, "top")]
        first, second = (eventually(images.poll, "an image", 30.0).message for _ in range(2))
        assert first.image.shape == (400, 640, 3)
        assert second.stamp > first.stamp
        # All that there is is noise of the sensor: two images have nothing in common.
        one, other = (frame.image.astype(float).ravel() for frame in (first, second))
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.05
        assert not [subscription for subscription in others if subscription.poll() is not None]


@pytest.mark.parametrize("simulate", [(), ("lidar", "lidar")])
def test_a_robot_without_a_sensor_is_refused(simulate):
    with pytest.raises(ValueError, match="simulate"):
        Settings(simulate=simulate)


def test_the_default_is_the_stereo_pair_alone():
    assert Settings().simulate == ("stereo",)
    assert Settings().sees
    assert not Settings().scans
