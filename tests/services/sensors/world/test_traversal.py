"""Drives of one route at many times of day: where they go, what they see, and that they can be repeated."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from common.geometry import inverse
from services.sensors.world import World
from services.sensors.world.route import waisted_loop
from services.sensors.world.traversal import DrivingSettings, ScanTraversal, Traversal, drive
from tests.services.sensors.world.conftest import SETTINGS

ROUTE = waisted_loop(72.0)
MORNING, EVENING = datetime(2026, 6, 21, 6, tzinfo=UTC), datetime(2026, 6, 21, 17, tzinfo=UTC)


def lateral(poses):
    """Distance to the left of the route at each pose, metres."""
    nearest = np.argmin(np.linalg.norm(poses[:, None, :2] - ROUTE[None, :, :2], axis=-1), axis=1)
    offset, yaw = poses[:, :2] - ROUTE[nearest, :2], ROUTE[nearest, 2]
    return offset[:, 1] * np.cos(yaw) - offset[:, 0] * np.sin(yaw)


def few(world, time, seed, count=3):
    """A traversal of the first few frames of a drive."""
    settings = DrivingSettings()
    return Traversal(world, drive(ROUTE, settings, np.random.default_rng(seed))[:count], time, settings, seed)


def test_a_drive_covers_the_route_at_its_spacing_and_points_where_it_goes():
    poses = drive(ROUTE, DrivingSettings(), np.random.default_rng(1))
    steps = np.diff(poses[:, :2], axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx(0.3, abs=0.005)
    assert len(poses) == pytest.approx(72.0 / 0.3, abs=4)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert (poses[:-1, 2] + poses[1:, 2]) / 2 == pytest.approx(heading, abs=0.02)


def test_drives_sway_by_what_is_set_and_none_is_like_another():
    drives = [drive(ROUTE, DrivingSettings(sway=0.1), np.random.default_rng(seed)) for seed in range(20)]
    offsets = np.concatenate([lateral(poses) for poses in drives])
    assert np.std(offsets) == pytest.approx(0.1, rel=0.25)
    assert np.abs(offsets).max() < 0.35
    assert np.abs(lateral(drives[0])[:200] - lateral(drives[1])[:200]).max() > 0.05
    straight = drive(ROUTE, DrivingSettings(sway=0.0), np.random.default_rng(0))
    assert np.abs(lateral(straight)).max() < 0.01


def test_a_part_of_the_route_is_driven_on_request():
    whole, part = (drive(ROUTE, DrivingSettings(length=length), np.random.default_rng(4)) for length in (None, 10.0))
    assert len(part) == pytest.approx(10.0 / 0.3, abs=1)
    assert np.array_equal(part, whole[: len(part)])


def test_its_truth_is_where_its_camera_was(world):
    traversal = few(world, EVENING, 5)
    stamps = [pair.stamp_ns for pair in traversal]
    assert len(traversal) == len(stamps) == 3
    assert stamps == traversal.stamps_ns.tolist()
    assert np.diff(stamps) == pytest.approx(0.25e9)
    assert stamps[0] == EVENING.timestamp() * 1e9
    assert world.T_world_vehicle @ world.camera.T_vehicle_camera == pytest.approx(traversal.poses_truth[-1])
    T_first_last = inverse(traversal.poses_truth[0]) @ traversal.poses_truth[-1]
    assert np.linalg.norm(T_first_last[:3, 3]) == pytest.approx(0.6, abs=0.05)
    assert np.degrees(world.light.elevation) == pytest.approx(19.0, abs=1.0)


def test_the_same_seed_gives_the_same_images_and_another_time_another_light(world: World):
    first, other = ([pair.left for pair in few(world, time, 5)] for time in (MORNING, EVENING))
    again = [pair.left for pair in few(world, MORNING, 5)]
    assert np.array_equal(first, again)
    # Each drive begins with an exposure of its own, so that evenings are no darker than mornings.
    assert np.mean(other[0]) == pytest.approx(np.mean(first[0]), rel=0.25)
    assert np.abs(np.subtract(first[0], other[0], dtype=np.int64)).mean() > 10.0


def test_a_drive_is_scanned_from_where_it_goes(world):
    settings = DrivingSettings(length=2.0)
    traversal = ScanTraversal.of(world, settings, 5)
    drives = [list(traversal) for _ in range(2)]
    assert len(traversal) == len(drives[0]) == len(traversal.poses_truth) > 3
    for (stamp, scan), (again, same) in zip(*drives, strict=True):
        assert stamp == again
        assert np.array_equal(scan.ranges, same.ranges)
        assert np.array_equal(scan.intensities, same.intensities)
    # The last column of a turn, straight behind, is fired from the pose that is called true at the stamp.
    last, T = drives[0][-1][1], traversal.poses_truth[-1]
    lidar = world.lidar
    flat, azimuth = np.cos(lidar.elevations), lidar.azimuths[-1]
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(lidar.elevations)], axis=-1) @ T[:3, :3].T
    ranges, _, _ = world.cast_rays(np.broadcast_to(T[:3, 3], rays.shape), rays)
    seen = last.ranges[:, -1] > 0.0
    assert seen.sum() > 10
    assert np.median(np.abs(ranges - last.ranges[:, -1])[seen]) < 0.03


def test_the_camera_says_what_an_invariant_image_needs(world):
    assert world.camera.wavelengths == SETTINGS.bands.peaks
    assert world.camera.transfer == SETTINGS.imaging.gamma


@pytest.mark.parametrize(
    ("name", "value"), [("spacing", 0.0), ("speed", -1.0), ("sway_length", 0.0), ("sway", -0.1), ("length", 0.0)]
)
def test_what_is_no_drive_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        DrivingSettings(**{name: value})
