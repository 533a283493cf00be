"""The pipeline in vehicle frames: keyframes, submaps and localization."""

from dataclasses import replace

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import Keyframe, VertexRecord
from services.estimator.lidar import FeatureError, Landmarks, LidarFeatures, LidarSettings, local_map, model
from services.estimator.lidar.pipeline import LidarPipeline
from services.estimator.lidar.settings import MappingSettings
from tests.services.estimator.lidar.scene import scan

MOUNTING = geometry.exp([0.3, 0.1, 1.2, 0.02, -0.03, 0.4])
VERTEX = VertexId(new_map_id("r1", 1), 0)
PERIOD = 100_000_000
OFF = geometry.exp([0.25, 0.15, 0.0, 0.0, 0.0, np.radians(5)])
PRIOR = Uncertain(np.eye(4), np.diag(np.repeat([0.3, 0.09], 3) ** 2))


def lidar_at(T_world_vehicle, **options):
    """A scan from the lidar of a vehicle that stands at a pose; the world's origin is the lidar's of one at rest."""
    return scan(geometry.inverse(MOUNTING) @ T_world_vehicle @ MOUNTING, **options)


@pytest.fixture(scope="module")
def made():
    return LidarPipeline(MOUNTING)


def record(keyframe):
    return VertexRecord(id=VERTEX, stamp=0, keyframe=keyframe)


def live_at(T, **options):
    return LidarPipeline(MOUNTING).process(lidar_at(T, **options)).live


def submap_at(made, T, **options):
    return made.read(record(made.keyframe(live_at(T, **options))))


def off(result, T):
    error = geometry.log(result.T_vertex_live.T @ geometry.inverse(T))
    return np.linalg.norm(error[:3]), np.linalg.norm(error[3:])


def test_motion_and_twist_are_the_vehicles():
    made = LidarPipeline(MOUNTING)
    motion = geometry.exp([0.4, 0.0, 0.0, 0.0, 0.0, 0.1])
    first = made.process(lidar_at(np.eye(4)))
    step = made.process(lidar_at(motion, seed=1, stamp=PERIOD), Uncertain(motion, 1e-2 * np.eye(6)))
    assert first.success
    assert step.success
    np.testing.assert_allclose(step.T_last_live.T, motion, atol=0.01)
    np.testing.assert_allclose(step.twist, geometry.log(motion) * 10, atol=0.1)
    assert step.inliers > 100


@pytest.mark.parametrize("by_prior", [True, False])
@pytest.mark.parametrize("side", [1, -1])
def test_localization_from_thirty_centimetres_and_five_degrees(made, by_prior, side):
    T = OFF if side > 0 else geometry.inverse(OFF)
    submap, live = submap_at(made, np.eye(4)), live_at(T, seed=7, noise=0.04)
    result = made.localize(submap, PRIOR, live) if by_prior else made.search(submap, live)
    assert result.success
    assert not result.reason
    assert off(result, T)[0] < 0.02
    assert off(result, T)[1] < 0.003
    assert result.members == (result.inliers,)
    error = geometry.log(result.T_vertex_live.T @ geometry.inverse(T))
    assert error @ np.linalg.solve(result.T_vertex_live.covariance, error) < 25.0


@pytest.mark.parametrize("lowest_first", [False, True])
def test_the_landmarks_that_agree_are_told_by_column_and_row_of_the_scan(made, lowest_first):
    seen = lidar_at(OFF, seed=7)
    if lowest_first:
        seen = replace(seen, points=seen.points[::-1].copy(), intensity=seen.intensity[::-1].copy())
    live = LidarPipeline(MOUNTING).process(seen).live
    result = made.localize(submap_at(made, np.eye(4)), PRIOR, live)
    assert result.pixels.shape == (result.inliers, 2)
    columns, rows = np.rint(live.features.pixels).astype(int).T
    found = model.to_measurements(seen.points[rows, columns % seen.points.shape[1]].astype(float))
    apart = np.abs(np.remainder(found[:, :2] - live.features.measurements[:, :2] + np.pi, 2.0 * np.pi) - np.pi)
    returned = found[:, 2] > 0.0
    assert returned.mean() > 0.9
    assert (np.percentile(apart[returned], 95, axis=0) < [0.01, 0.02]).all()
    assert set(map(tuple, result.pixels)) <= set(map(tuple, live.features.pixels))


def test_a_pose_that_contradicts_the_prior_is_none(made):
    submap, live = submap_at(made, np.eye(4)), live_at(OFF, seed=7)
    sure = Uncertain(geometry.exp([0.1, 0.0, 0.0, 0.0, 0.0, 0.01]) @ OFF, 1e-4 * np.eye(6))
    result = made.localize(submap, sure, live)
    assert not result.success
    assert "prior" in result.reason
    assert np.array_equal(result.T_vertex_live.T, sure.T)


def test_another_place_is_refused(made):
    elsewhere = live_at(geometry.exp([-14.0, 0.0, 0.0, 0.0, 0.0, 2.0]), seed=3)
    submap = submap_at(made, geometry.exp([12.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    for result in (made.localize(submap, PRIOR, elsewhere), made.search(submap, elsewhere)):
        assert not result.success
        assert result.reason


def test_an_empty_map_is_a_failure_with_a_sentence(made):
    empty = LidarFeatures.empty().landmarks()
    keyframe = Keyframe(pipeline="lidar", arrays={**empty.to_arrays(), "T_vehicle_lidar": MOUNTING})
    submap, live = made.read(record(keyframe)), live_at(OFF)
    for result in (made.localize(submap, PRIOR, live), made.search(submap, live)):
        assert not result.success
        assert "0 landmarks" in result.reason


def test_a_joint_submap_localizes_in_the_frame_of_the_first(made):
    second = geometry.exp([1.5, 0.2, 0.0, 0.0, 0.0, 0.1])
    sure = Uncertain(second, 1e-6 * np.eye(6))
    joint = made.join([(submap_at(made, np.eye(4)), Uncertain.identity()), (submap_at(made, second, seed=4), sure)])
    T = geometry.exp([1.4, 0.0, 0.0, 0.0, 0.0, 0.05])
    result = made.localize(joint, Uncertain(T @ geometry.inverse(OFF), PRIOR.covariance), live_at(T, seed=8))
    assert result.success
    assert off(result, T)[0] < 0.02
    assert len(result.members) == 2
    assert min(result.members) > 20
    assert sum(result.members) == result.inliers


def test_a_keyframe_is_compact_and_whole(made):
    live = live_at(np.eye(4))
    keyframe = made.keyframe(live)
    arrays = keyframe.arrays
    assert sum(a.nbytes for a in arrays.values()) < 110 * len(arrays["points"]) + 200
    assert len(arrays["points"]) <= LidarSettings().mapping.max_landmarks
    assert keyframe.thumbnail.startswith(b"\xff\xd8")
    back = Landmarks.from_arrays(arrays)
    looks = local_map(live.features.landmarks(), LidarSettings().mapping).looks
    np.testing.assert_allclose(back.looks, looks, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(back.looks, axis=1), 1.0, atol=1e-5)


def test_kept_landmarks_are_all_around():
    landmarks = live_at(np.eye(4)).features.landmarks()
    few = local_map(landmarks, MappingSettings(max_landmarks=100))
    assert len(few) == 100
    azimuth = np.arctan2(few.points[:, 1], few.points[:, 0])
    assert len(np.unique((azimuth // (np.pi / 6)).astype(int))) == 12


def test_a_keyframe_that_is_not_whole_is_refused(made):
    keyframe = made.keyframe(live_at(np.eye(4)))
    arrays = dict(keyframe.arrays)
    broken = [
        keyframe.model_copy(update={"pipeline": "stereo"}),
        keyframe.model_copy(update={"arrays": {k: v for k, v in arrays.items() if k != "T_vehicle_lidar"}}),
        keyframe.model_copy(update={"arrays": {k: v for k, v in arrays.items() if k != "points"}}),
        keyframe.model_copy(update={"arrays": {**arrays, "points": arrays["points"].astype(np.float64)}}),
        keyframe.model_copy(update={"arrays": {**arrays, "points": arrays["points"] * np.float32(np.nan)}}),
        keyframe.model_copy(update={"arrays": {**arrays, "laplacians": arrays["laplacians"][1:]}}),
    ]
    for bad in broken:
        with pytest.raises(FeatureError):
            made.read(record(bad))
