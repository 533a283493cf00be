import cv2
import numpy as np
import pytest

from services.estimator.stereo import matching, refinement
from services.estimator.stereo.settings import NoiseSettings
from tests.services.estimator.stereo.scene import shifted_texture


def _texture(seed=0):
    return shifted_texture((0.0, 0.0), (160, 160), seed)[0]


def _magnified(image, dx, dy, scale):
    """The image in which what was at (80, 80) is at (80 + dx, 80 + dy), magnified about there."""
    A = np.array([[scale, 0, 80 + dx - scale * 80], [0, scale, 80 + dy - scale * 80]])
    return cv2.warpAffine(image, A, image.shape[::-1], flags=cv2.INTER_CUBIC)


def _align(patch, image, scale=1.0):
    start = np.array([[80.0, 80.0]], np.float32)
    return refinement.align(patch, image.astype(np.uint8), start, scale * np.eye(2, dtype=np.float32)[None], 20)[0]


PLACE = np.array([[80, 80]], np.int32)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.25, -0.375), (0.5, 0.5), (-1.25, 0.875)])
def test_a_shift_is_recovered_to_a_small_part_of_a_pixel(shift):
    image, shifted = shifted_texture(shift, (160, 160))
    u, v, score, *_ = _align(refinement.extract(image.astype(np.uint8), PLACE), shifted)
    assert (u - 80, v - 80) == pytest.approx(shift, abs=0.04)
    assert score > 0.98


def test_a_change_of_light_does_not_move_the_patch():
    image, shifted = shifted_texture((0.375, 0.25), (160, 160), seed=1)
    u, v, score, *_ = _align(refinement.extract(image.astype(np.uint8), PLACE), 0.5 * shifted + 40)
    assert (u - 80, v - 80) == pytest.approx((0.375, 0.25), abs=0.05)
    assert score > 0.98


def test_a_patch_seen_from_nearer_is_compared_at_its_scale():
    image = _texture(2)
    patch = refinement.extract(image.astype(np.uint8), PLACE)
    u, v, score, *_ = _align(patch, _magnified(image, 0.5, -0.3, 1.4), scale=1.4)
    assert (u - 80, v - 80) == pytest.approx((0.5, -0.3), abs=0.08)
    assert score > 0.97
    assert _align(patch, _magnified(image, 0.5, -0.3, 1.4), scale=1.0)[2] < score


def test_what_cannot_be_aligned_says_so():
    image = _texture(3).astype(np.uint8)
    flat = np.full((1, 13, 13), 90, np.uint8)
    edge = np.tile(np.linspace(0, 240, 13).astype(np.uint8), (13, 1))[None]
    assert _align(flat, image)[2] == -1.0
    assert _align(edge, image)[2] == -1.0, "an edge can slide along itself"
    outside = np.array([[2.0, 2.0]], np.float32)
    assert (
        refinement.align(refinement.extract(image, PLACE), image, outside, np.eye(2, dtype=np.float32)[None], 10)[0, 2]
        == -1.0
    )


def test_correlation_equals_its_definition():
    rng = np.random.default_rng(4)
    a, b = (rng.integers(0, 256, (30, 30), dtype=np.uint8) for _ in range(2))
    first, second = a[5:16, 7:18].ravel().astype(float), b[9:20, 10:21].ravel().astype(float)
    assert refinement.correlation(a, 12, 10, b, 15, 14) == pytest.approx(np.corrcoef(first, second)[0, 1])
    assert refinement.correlation(a, 12, 10, np.zeros((30, 30), np.uint8), 15, 14) == 0.0


@pytest.mark.parametrize("noise", [4.0, 12.0])
def test_the_place_is_as_uncertain_as_its_errors(noise):
    rng = np.random.default_rng(5)
    image = _texture(5)
    patch = refinement.extract(image.astype(np.uint8), PLACE)
    nees = []
    for _ in range(150):
        row = _align(patch, np.clip(image + rng.normal(0.0, noise, image.shape), 0, 255))
        covariance = matching.place_noise(row[None], np.ones(1), NoiseSettings())[0]
        error = row[:2] - 80.0
        nees.append(error @ np.linalg.solve(covariance, error))
    # Two degrees of freedom; at the most the errors are a fifth larger than told.
    assert np.mean(nees) < 2.0 * 1.2**2


@pytest.mark.parametrize("slant", [-0.15, 0.0, 0.1, 0.2])
def test_the_slant_of_a_surface_is_measured_with_its_disparity(slant):
    left = _texture(6)
    # What is at (x, y) in the left image is at x - (8.25 + slant (y - 80)) in the right one.
    A = np.array([[1.0, -slant, -8.25 + 80.0 * slant], [0.0, 1.0, 0.0]])
    right = cv2.warpAffine(left, A, left.shape[::-1], flags=cv2.INTER_CUBIC).astype(np.uint8)
    start = np.array([[72.0, 80.0]], np.float32)
    u, v, score, found, variance = refinement.align_pair(
        refinement.extract(left.astype(np.uint8), PLACE), right, start, 20
    )[0]
    assert (u, v) == pytest.approx((80 - 8.25, 80.0), abs=0.1)
    assert score > 0.97
    assert found == pytest.approx(slant, abs=0.03)
    assert 0.0 < variance < 0.1
