import cv2
import numpy as np
import pytest

from common.camera import StereoCamera
from services.estimator.stereo import StereoSettings, preprocess
from services.estimator.stereo.preprocessing import ImageError
from services.estimator.stereo.rectification import Rectification, triangulate
from services.estimator.stereo.settings import NoiseSettings
from tests.services.estimator.stereo.scene import CAMERA, render, shifted_texture

SETTINGS = StereoSettings()


def _textured_pair(disparity, vertical=0.0):
    """A fronto-parallel texture, the right image shifted by exactly the disparity."""
    pair = shifted_texture((-disparity, vertical), (CAMERA.width, CAMERA.height), seed=7)
    return tuple(image.astype(np.uint8) for image in pair)


@pytest.mark.parametrize("disparity", [3.0, 12.25, 40.5, 77.875])
@pytest.mark.parametrize("vertical", [0.0, 0.375])
def test_disparity_is_exact_to_a_small_part_of_a_pixel(disparity, vertical):
    features = preprocess(*_textured_pair(disparity, vertical), 0, CAMERA, SETTINGS).features
    measured = features.measurements[:, 0] - features.measurements[:, 2]
    assert len(features) > 100
    assert np.median(measured) == pytest.approx(disparity, abs=0.02)
    assert np.mean(np.abs(measured - disparity) < 0.15) > 0.95
    np.testing.assert_allclose(np.median(features.landmarks[:, 2]), CAMERA.fx * CAMERA.baseline / disparity, rtol=0.01)


def test_features_are_capped_and_lie_on_what_is_seen():
    left, right = render(np.eye(4))
    frame = preprocess(left, right, 5, CAMERA, SETTINGS)
    assert frame.stamp_ns == 5
    assert 150 < len(frame.features) <= SETTINGS.preprocessing.max_features
    _, y, z = frame.features.landmarks.T
    assert np.median(np.abs(y[(z < 6) & (y > 1.0)] - 1.2)) < 0.03, "the ground is 1.2 m below the camera"
    assert frame.features.patches[0, 6, 6] == left[tuple(frame.features.measurements[0, 1::-1].astype(int))]


def test_colour_images_are_taken_as_their_grey():
    left, right = render(np.eye(4))
    colour = [cv2.cvtColor(i, cv2.COLOR_GRAY2RGB) for i in (left, right)]
    grey, coloured = preprocess(left, right, 0, CAMERA, SETTINGS), preprocess(*colour, 0, CAMERA, SETTINGS)
    np.testing.assert_array_equal(grey.features.landmarks, coloured.features.landmarks)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_an_image_without_texture_has_no_features(value):
    image = np.full((320, 480), value, np.uint8)
    assert len(preprocess(image, image, 0, CAMERA, SETTINGS).features) == 0


def test_unrelated_noise_in_the_two_images_hardly_corresponds():
    rng = np.random.default_rng(0)
    left, right = (rng.integers(0, 256, (320, 480), dtype=np.uint8) for _ in range(2))
    assert len(preprocess(left, right, 0, CAMERA, SETTINGS).features) < 5


@pytest.mark.parametrize(
    "image", [np.zeros((320, 480), np.uint16), np.zeros((100, 480), np.uint8), np.zeros((320, 480, 4), np.uint8)]
)
def test_an_image_of_another_kind_is_refused(image):
    with pytest.raises(ImageError):
        preprocess(image, image, 0, CAMERA, SETTINGS)


def test_landmark_covariance_is_that_of_simulated_noise():
    camera = StereoCamera(1241, 376, 718.0, 718.0, 607.0, 185.0, 0.54)
    noise, rng = NoiseSettings(), np.random.default_rng(1)
    features = preprocess(*render(np.eye(4)), 0, CAMERA, SETTINGS).features.select(np.zeros(4000, int))
    true = camera.project([3.0, 1.0, 15.0])
    sigma = [noise.landmark_pixel, noise.landmark_pixel, noise.disparity]
    drawn = true + rng.normal(size=(4000, 3)) * sigma
    drawn[:, 2] = true[2] + (drawn[:, 0] - true[0]) - (drawn[:, 2] - true[2])
    object.__setattr__(features, "measurements", drawn.astype(np.float32))
    got = triangulate(features, camera, noise, Rectification.unknown(noise), 0.5)
    error = got.landmarks - np.array([3.0, 1.0, 15.0], np.float32)
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(got.covariances.astype(float)), error)
    assert nees.mean() == pytest.approx(3.0, rel=0.1)


def test_a_known_error_of_the_disparity_is_taken_off():
    noise = NoiseSettings()
    features = preprocess(*_textured_pair(20.0), 0, CAMERA, SETTINGS).features
    off = Rectification(np.array([0.5, 0.0]), np.eye(2))
    corrected = triangulate(features, CAMERA, noise, off, 0.5)
    assert np.median(corrected.landmarks[:, 2]) == pytest.approx(CAMERA.fx * CAMERA.baseline / 19.5, rel=0.003)
