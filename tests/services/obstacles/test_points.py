"""Scans and stereo pairs as points of the vehicle frame."""

import cv2
import numpy as np
import pytest

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE, StereoCamera
from services.obstacles.points import StereoPoints, of_scan
from services.obstacles.zones import ZoneSettings, look

HEIGHT = 0.9
WALL_WIDTH = 1.2


def camera():
    T = np.array(OPTICAL_IN_VEHICLE)
    T[2, 3] = HEIGHT
    return StereoCamera(640, 400, 380.0, 380.0, 320.0, 200.0, 0.24, T)


def pair_of_a_wall(distance):
    """A textured ground, and a wall at a distance before it, as both cameras see them."""
    c = camera()
    rng = np.random.default_rng(1)
    images = []
    v, u = np.indices((c.height, c.width), dtype=np.float32)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (2000, 2000)).astype(np.float32), (0, 0), 1.0)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    for shift in (0.0, c.baseline):
        down = (v - c.cy) / c.fy
        z = np.where(down > HEIGHT / distance, HEIGHT / np.maximum(down, 1e-6), distance).astype(np.float32)
        x = (u - c.cx) / c.fx * z + shift
        side = np.where(z == np.float32(distance), down * z * 90 + 700, z * 90)
        images.append(cv2.remap(texture, (x * 90 + 1000).astype(np.float32), side.astype(np.float32), cv2.INTER_LINEAR))
    return [image.astype(np.uint8) for image in images]


@pytest.mark.parametrize(("distance", "zone"), [(1.0, "stop"), (2.8, "slow"), (6.0, "clear")])
def test_a_wall_is_seen_where_it_stands_and_the_ground_is_not_in_the_way(distance, zone):
    points = StereoPoints(camera(), 240, 0.5).of_pair(*pair_of_a_wall(distance))
    standing = points[(points[:, 2] > 0.4) & (np.abs(points[:, 1]) < 0.4)]
    assert np.median(standing[:, 0]) == pytest.approx(distance, rel=0.06)
    found = look(points, ZoneSettings())
    needed = ZoneSettings().points
    assert (found.stop >= needed, found.slow >= needed) == (zone == "stop", zone != "clear")


def test_colours_are_as_good_as_grey():
    left, right = pair_of_a_wall(1.0)
    stereo = StereoPoints(camera(), 240, 0.5)
    grey = stereo.of_pair(left, right)
    coloured = stereo.of_pair(*(np.repeat(image[:, :, None], 3, axis=2) for image in (left, right)))
    assert len(coloured) == pytest.approx(len(grey), rel=0.02)


def test_a_scan_s_points_are_where_its_beams_end():
    T = geometry.from_xy_yaw(0.3, 0.0, np.pi / 2)
    T[2, 3] = 1.0
    ranges = np.array([[2.0, 0.0, 4.0], [1.0, 3.0, 0.0]], dtype=np.float32)
    elevations, azimuths = np.array([0.0, -0.5]), np.array([0.0, 0.7, -0.7])
    points = of_scan(ranges, elevations, azimuths, T)
    expected = []
    for row, elevation in enumerate(elevations):
        for column, azimuth in enumerate(azimuths):
            if r := ranges[row, column]:
                flat = np.cos(elevation)
                beam = r * np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
                expected.append(T[:3, :3] @ beam + T[:3, 3])
    assert points == pytest.approx(np.array(expected))
    assert of_scan(ranges, np.tile(elevations[:, None], 3), np.tile(azimuths, (2, 1)), T) == pytest.approx(points)


def test_the_left_of_the_image_is_watched_as_well_and_black_images_are_blind():
    stereo = StereoPoints(camera(), 240, 0.5)
    points = stereo.of_pair(*pair_of_a_wall(2.0))
    standing = points[(points[:, 2] > 0.4) & (np.abs(points[:, 0] - 2.0) < 0.2)]
    assert standing[:, 1].max() > 1.2, "as far as the right camera sees"
    assert stereo.seen > 0.5
    black = np.zeros((400, 640), np.uint8)
    stereo.of_pair(black, black)
    assert stereo.seen < 0.05
