"""The sensors as a process: a time of day that is asked for arrives in the images, and the base drives on meanwhile."""

import numpy as np
import pytest

from common import topics
from common.messages import Place, VelocityCommand, WorldTime, now_ns
from tests.processes import Robot, eventually, every

SMALL = """
[sensors.world]
time = 2026-06-21T09:00:00Z
[sensors.world.scene]
extent = 64.0
trees = 4
bushes = 2
boxes = 2
stones = 5
tufts = 5
houses = 1
walls = 1
fences = 1
"""
EVENING = WorldTime(stamp=round(1_782_061_200 * 1e9))
"""2026-06-21 17:00 UTC."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("sensors"), SMALL) as running:
        running.start("sensors")
        yield running


def test_the_sun_moves_on_request_while_the_base_drives(robot):
    safety, operator = robot.act_as("safety"), robot.bus("operator")
    frames, truth = operator.subscribe(topics.STEREO), operator.subscribe(topics.TRUTH)
    safe = safety.publisher(topics.SAFE)

    def newest():
        asked = now_ns()
        received = eventually(lambda: (last := frames.last()) and last.message.stamp > asked and last, "a frame", 30.0)
        return received.message

    def speed():
        return abs(eventually(truth.last, "the truth").message.w)

    before, again = newest(), newest()
    stood = truth.last().message.T_world_vehicle
    with every(0.05, lambda: safe.put(VelocityCommand(stamp=now_ns(), v=0.0, w=0.6))):
        eventually(lambda: speed() > 0.4, "the base turns")
        answer = operator.ask(topics.TRUTH_TIME, EVENING, timeout=60.0)
        assert "17:00 UTC" in answer.text
        assert speed() > 0.4
    x, y, yaw = float(stood[0, 3]), float(stood[1, 3]), float(np.arctan2(stood[1, 0], stood[0, 0]))
    eventually(lambda: speed() < 0.01, "the base stands")
    operator.ask(topics.TRUTH_PLACE, Place(x=x, y=y, yaw=yaw))
    after = newest()
    noise = np.abs(before.left.astype(float) - again.left).mean()
    assert np.abs(before.left.astype(float) - after.left).mean() > 3.0 * noise
    assert after.camera.wavelengths == pytest.approx((610e-9, 540e-9, 460e-9))
