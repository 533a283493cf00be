import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from services.estimator.mounting import in_sensor_frames, in_vehicle_frames
from services.estimator.stereo import (
    FeatureError,
    FeatureSet,
    StereoLocalizer,
    StereoSettings,
    join,
    local_map,
    move,
    preprocess,
)
from services.estimator.stereo.settings import MappingSettings
from tests.services.estimator.stereo.scene import CAMERA, render

SETTINGS = StereoSettings()
LOCALIZER = StereoLocalizer(CAMERA)
T_MAP_LIVE = geometry.exp([0.25, 0.0, 0.3, 0.0, 0.06, 0.0])
WIDE = np.diag(np.repeat([0.2, 0.05], 3) ** 2)


def _frame(T, **options):
    return preprocess(*render(T, **options), 0, CAMERA, SETTINGS)


@pytest.fixture(scope="module")
def taught():
    return local_map(_frame(np.eye(4)).features, SETTINGS.mapping)


@pytest.fixture(scope="module")
def live():
    return _frame(T_MAP_LIVE, seed=1)


def _distance(result, truth=T_MAP_LIVE):
    error = geometry.log(geometry.inverse(truth) @ result.T_map_live.T)
    return np.linalg.norm(error[:3]), np.degrees(np.linalg.norm(error[3:]))


def test_a_live_pair_is_localized_from_a_rough_prior(taught, live):
    prior = Uncertain(geometry.exp([0.15, 0.0, -0.1, 0.0, 0.03, 0.0]) @ T_MAP_LIVE, WIDE)
    result = LOCALIZER.localize(taught, live, prior)
    assert result.success, result.reason
    assert _distance(result) < (0.03, 0.3)
    assert result.inliers == len(result.inlier_landmarks) == len(result.inlier_places) > 30
    expected = in_vehicle_frames(result.T_map_live, CAMERA.T_vehicle_camera)
    np.testing.assert_allclose(result.T_map_live_vehicle.T, expected.T)


def test_a_prior_that_is_contradicted_is_a_failure_and_stays_the_estimate(taught, live):
    prior = Uncertain(
        geometry.exp([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]) @ T_MAP_LIVE, np.diag(np.repeat([0.004, 0.02], 3) ** 2)
    )
    result = LOCALIZER.localize(taught, live, prior)
    assert not result.success
    assert result.reason
    np.testing.assert_array_equal(result.T_map_live.T, prior.T)


@pytest.mark.parametrize(
    "offset", [[0, 0, 0, 0, 0, 0], [0.5, 0, 0.6, 0, 0, 0], [-0.6, 0, 0.3, 0, -0.26, 0], [0, 0, 0.5, 0, 0.26, 0]]
)
def test_without_a_prior_a_metre_and_fifteen_degrees_are_found_or_refused(taught, offset):
    truth = geometry.exp(np.array(offset, float))
    result = LOCALIZER.localize_without_prior(taught, _frame(truth, seed=2))
    if result.success:
        assert _distance(result, truth) < (0.05, 0.5)
    assert result.success or np.linalg.norm(offset) > 0.6


@pytest.mark.parametrize("seed", range(4))
def test_another_place_is_refused(taught, seed):
    rng = np.random.default_rng(seed)
    texture = rng.integers(0, 256, (80, 120), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
    other = preprocess(texture, np.roll(texture, -10 - seed, 1), 0, CAMERA, SETTINGS)
    assert len(other.features) > 50
    assert not LOCALIZER.localize(taught, other, Uncertain(np.eye(4), WIDE)).success
    assert not LOCALIZER.localize_without_prior(taught, other).success


def test_a_blind_pair_is_refused(taught):
    black = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    blind = preprocess(black, black, 0, CAMERA, SETTINGS)
    result = LOCALIZER.localize(taught, blind, Uncertain(T_MAP_LIVE, WIDE))
    assert not result.success
    assert result.inliers == 0


def test_a_joint_map_of_two_vertices_localizes_as_well(taught, live):
    T_first_second = geometry.exp([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    second = move(_frame(T_first_second, seed=3).features, Uncertain(T_first_second, 1e-6 * np.eye(6)))
    result = LOCALIZER.localize(join([taught, second]), live, Uncertain(T_MAP_LIVE, WIDE))
    assert result.success, result.reason
    assert _distance(result) < (0.03, 0.3)
    assert (result.inlier_landmarks >= len(taught)).any()


def test_moving_a_map_moves_its_landmarks_and_widens_them(taught):
    T = geometry.exp([0.1, 0.2, 0.3, 0.02, 0.1, 0.0])
    moved = move(taught, Uncertain(T, 1e-4 * np.eye(6)), min_depth=-1e9)
    np.testing.assert_allclose(moved.landmarks, geometry.apply(T, taught.landmarks.astype(float)), rtol=1e-5, atol=1e-4)
    traces = [np.einsum("nii->n", f.covariances) for f in (taught, moved)]
    assert (traces[1] > traces[0]).all()
    assert (move(taught, Uncertain.exactly(geometry.exp([0, 0, -8.0, 0, 0, 0]))).landmarks[:, 2] > 0.5).all()


def test_a_local_map_is_bounded_and_spread():
    frame = _frame(np.eye(4))
    kept = local_map(frame.features, MappingSettings(max_landmarks=60))
    assert len(kept) == 60
    assert np.ptp(kept.measurements[:, 0]) > 0.8 * np.ptp(frame.features.measurements[:, 0])
    assert sum(a.nbytes for a in local_map(frame.features, SETTINGS.mapping).to_arrays().values()) < 200_000
    assert len(join([])) == 0


def test_features_survive_storage_and_damage_is_noticed(taught):
    arrays = taught.to_arrays()
    again = FeatureSet.from_arrays(arrays)
    np.testing.assert_array_equal(again.patches, taught.patches)
    damaged = [
        {k: v for k, v in arrays.items() if k != "patches"},
        {**arrays, "descriptors": arrays["descriptors"][:, :16]},
        {**arrays, "landmarks": arrays["landmarks"][:-1]},
        {**arrays, "landmarks": arrays["landmarks"] * np.float32(np.nan)},
        {**arrays, "depths": arrays["depths"].astype(np.float64)},
    ]
    for wrong in damaged:
        with pytest.raises(FeatureError):
            FeatureSet.from_arrays(wrong)


def test_vehicle_and_camera_frames_are_two_views_of_one_motion():
    forward = Uncertain(geometry.exp([0.0, 0.0, 1.0, 0.0, 0.1, 0.0]), np.diag([1e-4, 1e-4, 4e-4, 1e-6, 1e-6, 1e-6]))
    vehicle = in_vehicle_frames(forward, CAMERA.T_vehicle_camera)
    assert vehicle.T[0, 3] == pytest.approx(1.0, abs=0.01), "z of the camera is x of the vehicle"
    assert vehicle.covariance[0, 0] == pytest.approx(4e-4)
    np.testing.assert_allclose(in_sensor_frames(vehicle, CAMERA.T_vehicle_camera).T, forward.T, atol=1e-12)
