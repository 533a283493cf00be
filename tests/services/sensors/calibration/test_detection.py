"""Corners are found to a fraction of a pixel, and blur is measured in pixels."""

import cv2
import numpy as np
import pytest

from services.sensors.calibration.detection import Detector, image_blur
from services.sensors.calibration.simulation import BOARD, simulated_poses


def projected(lens, T, ids):
    points = cv2.projectPoints(BOARD.corners[ids], cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], lens.matrix, lens.distortion)
    return points[0].reshape(-1, 2)


def test_corners_are_where_the_lens_shows_them(renderer):
    rng, detector, errors = np.random.default_rng(2), Detector(BOARD), []
    for T in simulated_poses(6, rng):
        found = detector.detect(renderer.pair(T, rng)[0])
        assert not found.reason
        errors.append(found.points - projected(renderer.rig.left, T, found.ids))
    errors = np.concatenate(errors)
    assert np.sqrt((errors**2).mean()) < 0.08
    assert np.abs(errors.mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("blur", [0.5, 1.0, 1.5, 2.0])
def test_blur_is_measured_in_pixels(renderer, blur):
    T = np.eye(4)
    T[:3, 3] = [-0.1, -0.1, 0.3]
    found = Detector(BOARD).detect(renderer.pair(T, np.random.default_rng(0), blur=blur)[0])
    # A pixel itself, and the interpolation that measures, spread an edge by half of a pixel.
    assert found.blur == pytest.approx(np.hypot(blur, 0.5), abs=0.25)
    assert bool(found.reason) == (found.blur > 2.0)


def test_blur_along_one_direction_is_seen(renderer):
    T = np.eye(4)
    T[:3, 3] = [-0.1, -0.1, 0.3]
    sharp = renderer.pair(T, np.random.default_rng(0))[0]
    moved = cv2.blur(sharp, (9, 1))
    assert "blurred" in Detector(BOARD).detect(moved).reason


def test_an_image_without_a_board_has_a_blur_too(renderer):
    T = np.eye(4)
    T[:3, 3] = [-0.1, -0.1, 0.3]
    sharp, soft = (renderer.pair(T, np.random.default_rng(0), blur=blur)[0] for blur in (0.7, 4.0))
    assert image_blur(sharp) < 1.5
    assert image_blur(soft) > 3.0
    assert image_blur(np.full((100, 100), 80, np.uint8)) == float("inf")
