"""A turn among far structure: the case in which an error that all disparities share would stretch the motion most.

Images are left out: features are drawn with realistic noise, and matched by who they are. All else is odometry's.
"""

from dataclasses import replace

import numpy as np
import pytest

from common import geometry
from common.camera import StereoCamera
from services.estimator.stereo import StereoOdometry, StereoSettings, matching
from services.estimator.stereo.brief import BYTES
from services.estimator.stereo.features import FeatureSet, StereoFrame
from services.estimator.stereo.rectification import triangulate
from services.estimator.stereo.refinement import PATCH

CAMERA = StereoCamera(1241, 376, 718.0, 718.0, 607.0, 185.0, 0.54)
TURN, FRAMES, STEP = np.radians(98.0), 50, 0.6
SIGMA_CORNER, SIGMA_PLACE, SIGMA_DISPARITY = 0.05, 0.15, 0.2
DT = 100_000_000
SETTINGS = StereoSettings()


def _path():
    step = geometry.exp([0.0, 0.0, STEP, 0.0, TURN / FRAMES, 0.0])
    return [np.linalg.matrix_power(step, i) for i in range(FRAMES + 1)]


def _points(rng, count=3000):
    """Points all around the turn, (N, 3) in the first optical frame."""
    bearing, distance = rng.uniform(0, 2 * np.pi, count), rng.uniform(15, 95, count)
    height = rng.uniform(-0.25, 0.25, count) * distance
    return np.stack([distance * np.sin(bearing), height, distance * np.cos(bearing)], -1) + _path()[FRAMES // 2][:3, 3]


def _frame(rng, T, points, stamp, offset, known):
    """What a pair at ``T`` shows of the points 20 to 80 m away; a feature's descriptor is its point's number.

    ``offset`` is the error of all disparities, pixels, ``known`` what was found out about it so far.
    """
    seen = points @ geometry.inverse(T)[:3, :3].T + geometry.inverse(T)[:3, 3]
    ids = np.flatnonzero((seen[:, 2] > 20.0) & (seen[:, 2] < 80.0))
    x, y, z = seen[ids].T
    u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
    inside = (u > 10) & (u < CAMERA.width - 10) & (v > 10) & (v < CAMERA.height - 10)
    ids, u, v, z = ids[inside], u[inside], v[inside], z[inside]
    count = len(ids)
    disparity = CAMERA.fx * CAMERA.baseline / z + offset + rng.normal(0.0, SIGMA_DISPARITY, count)
    u, v = u + rng.normal(0.0, SIGMA_CORNER, count), v + rng.normal(0.0, SIGMA_CORNER, count)
    order = np.lexsort((u, v))
    descriptors = np.zeros((count, BYTES), np.uint8)
    descriptors[:, :4] = ids.astype("<u4").reshape(-1, 1).view(np.uint8)
    features = FeatureSet(
        measurements=np.stack([u, v, u - disparity], -1).astype(np.float32),
        landmarks=np.zeros((count, 3), np.float32),
        covariances=np.zeros((count, 3, 3), np.float32),
        depths=np.zeros(count, np.float32),
        slants=np.zeros(count, np.float32),
        disparity_sigmas=np.full(count, SIGMA_DISPARITY, np.float32),
        descriptors=descriptors,
        patches=np.zeros((count, PATCH, PATCH), np.uint8),
    ).select(order)
    return StereoFrame(stamp, np.zeros((1, 1), np.uint8), triangulate(features, CAMERA, SETTINGS.noise, known, 0.7))


def _match_by_name(rng, outliers=0.1):
    """In place of the search: every point that both show, some of them somewhere else."""

    def match(landmarks, live, _prior, camera, _settings, _noise):
        names = [f.descriptors[:, :4].copy().view("<u4").ravel() for f in (landmarks, live.features)]
        _, of_landmark, of_feature = np.intersect1d(*names, assume_unique=True, return_indices=True)
        uvd = live.features.measurements[of_feature].astype(np.float64)
        uvd[:, 2] = camera.fx * camera.baseline / live.features.landmarks[of_feature, 2]
        uvd[:, :2] += rng.normal(0.0, SIGMA_PLACE, (len(uvd), 2))
        wrong = rng.random(len(uvd)) < outliers
        uvd[wrong, :2] += rng.uniform(-20, 20, (wrong.sum(), 2))
        noise = np.tile(np.diag([SIGMA_PLACE**2, SIGMA_PLACE**2, SIGMA_DISPARITY**2]), (len(uvd), 1, 1))
        return matching.Matches(of_landmark, of_feature, uvd, noise)

    return match


def _scale(monkeypatch, seed, offset, settings=SETTINGS):
    """How long odometry takes the turn to be, and how far its end, as parts of what they are."""
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(matching, "match", _match_by_name(rng))
    odometry, points, poses = StereoOdometry(CAMERA, settings), _points(rng), []
    for i, T in enumerate(_path()):
        result = odometry.process_frame(_frame(rng, T, points, i * DT, offset, odometry.rectification))
        assert result.success
        poses.append(result.T_odom_live)
    # Of every fifth pose, or the noise of each would make the path longer.
    found, true = (np.array(p)[::5, :3, 3] for p in (poses, _path()))
    lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (found, true)]
    return np.array([lengths[0] / lengths[1], np.linalg.norm(found[-1]) / np.linalg.norm(true[-1])])


@pytest.mark.parametrize("offset", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_a_turn_among_far_structure_keeps_its_scale(monkeypatch, seed, offset):
    np.testing.assert_allclose(_scale(monkeypatch, seed, offset), 1.0, atol=0.02)


def test_it_is_the_estimate_of_the_rectification_that_keeps_it(monkeypatch):
    """The same turn by odometry that trusts the calibration is stretched: the test above can tell."""
    trusting = replace(SETTINGS.noise, disparity_offset=1e-4, disparity_curvature=1e-4)
    scale = _scale(monkeypatch, 0, -0.3, replace(SETTINGS, noise=trusting))
    assert (scale > 1.025).all()
