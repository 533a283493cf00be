"""A sensor that hangs, and repeats its last frame."""

import numpy as np
import pytest

from common.camera import StereoCamera
from common.messages import CameraFrame, CameraModel, LidarScan, StereoFrame
from services.estimator.repeats import Repeats, without_sight

RNG = np.random.default_rng(1)
CAMERA = CameraModel.of(StereoCamera(64, 48, 60.0, 60.0, 32.0, 24.0, 0.2))
PICTURES = {"stereo": ("left", "right"), "camera": ("image",), "lidar": ("ranges",)}
DRIVES, STANDS = (0.5, 0.0), (0.0, 0.0)


def image():
    return RNG.integers(0, 255, (48, 64), np.uint8)


def pair(left, right):
    return StereoFrame(stamp=1, camera=CAMERA, left=left, right=right)


def scan():
    return LidarScan(
        stamp=1,
        T_vehicle_lidar=np.eye(4),
        ranges=RNG.uniform(1.0, 9.0, (16, 64)).astype(np.float32),
        intensities=np.ones((16, 64), np.uint8),
        elevations=np.linspace(0.2, -0.2, 16),
        azimuths=np.linspace(np.pi, -np.pi, 64),
        offsets=np.zeros(64),
    )


def frames(kind):
    match kind:
        case "stereo":
            return pair(image(), image()), pair(image(), image())
        case "camera":
            return CameraFrame(stamp=1, image=image()), CameraFrame(stamp=2, image=image())
    return scan(), scan()


@pytest.mark.parametrize("kind", ["stereo", "camera", "lidar"])
def test_a_frame_that_comes_again_while_the_wheels_turn_is_a_repeat(kind):
    first, second = frames(kind)
    seen = Repeats(PICTURES[kind])
    told = [seen.repeats(frame, DRIVES) for frame in (first, first, first, second, first, first)]
    assert told == [False, True, True, False, False, True]


def test_a_robot_at_rest_may_see_the_same_twice():
    first, _ = frames("stereo")
    seen = Repeats(PICTURES["stereo"])
    assert [seen.repeats(first, twist) for twist in (STANDS, STANDS, None, (0.0, 0.01))] == [False] * 4


def test_a_sensor_that_hangs_still_hangs_when_the_robot_has_stopped():
    first, second = frames("stereo")
    seen = Repeats(PICTURES["stereo"])
    assert [seen.repeats(first, twist) for twist in (DRIVES, DRIVES, STANDS, STANDS)] == [False, True, True, True]
    assert not seen.repeats(second, STANDS)
    assert not seen.repeats(second, STANDS)


def test_one_camera_of_a_pair_may_hang():
    left = image()
    seen = Repeats(PICTURES["stereo"])
    assert [seen.repeats(pair(left, image()), DRIVES) for _ in range(3)] == [False, True, True]


@pytest.mark.parametrize("kind", ["stereo", "camera", "lidar"])
def test_what_is_repeated_is_taken_for_nothing_seen(kind):
    first, _ = frames(kind)
    blind = without_sight(first, PICTURES[kind])
    assert type(blind) is type(first)
    assert blind.stamp == first.stamp
    assert all(getattr(blind, name).max() == 0 and getattr(first, name).max() > 0 for name in PICTURES[kind])


def test_beams_that_see_the_sky_repeat_nothing():
    seen = Repeats(PICTURES["lidar"])
    scans = [scan() for _ in range(4)]
    for one in scans:
        one.ranges[:12] = 0.0
    assert [seen.repeats(one, DRIVES) for one in scans] == [False] * 4
    assert seen.repeats(scans[-1], DRIVES)


def test_a_covered_lens_repeats_nothing():
    black = np.zeros((48, 64), np.uint8)
    seen = Repeats(PICTURES["stereo"])
    assert [seen.repeats(pair(black, black), DRIVES) for _ in range(3)] == [False] * 3
