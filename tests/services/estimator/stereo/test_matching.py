import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from services.estimator.stereo import StereoSettings, matching, preprocess
from services.estimator.stereo.settings import MatchingSettings, NoiseSettings
from tests.services.estimator.stereo.scene import CAMERA, render

SETTINGS, NOISE = StereoSettings(), NoiseSettings()
T_WORLD_LIVE = geometry.exp([0.06, 0.0, 0.2, 0.0, 0.02, 0.0])


@pytest.fixture(scope="module")
def frames():
    return tuple(preprocess(*render(T), 0, CAMERA, SETTINGS) for T in (np.eye(4), T_WORLD_LIVE))


def _brute_force(a, b, settings):
    """Mutual nearest descriptors with the ratio test, over all pairs."""
    bits = [np.unpackbits(f.descriptors, axis=1).astype(int) for f in (a, b)]
    distance = (bits[0][:, None] != bits[1][None]).sum(-1)
    pairs = {}
    for i, row in enumerate(distance):
        order = np.argsort(row, kind="stable")
        if row[order[0]] <= settings.max_hamming and row[order[0]] <= settings.ratio * row[order[1]]:
            j = int(order[0])
            if j not in pairs or row[j] < distance[pairs[j], j]:
                pairs[j] = i
    return {(i, j) for j, i in pairs.items()}


def test_with_wide_gates_active_search_is_brute_force(frames):
    wide = MatchingSettings(max_radius=1e6)
    prior = Uncertain(geometry.inverse(T_WORLD_LIVE), 1e6 * np.eye(6))
    found, features, _ = matching.search(frames[0].features, frames[1].features, prior, CAMERA, wide, NOISE)
    assert set(zip(found.tolist(), features.tolist(), strict=True)) == _brute_force(
        frames[0].features, frames[1].features, wide
    )


def test_a_good_prior_finds_more_and_only_right_matches(frames):
    T = geometry.inverse(T_WORLD_LIVE)
    near = Uncertain(geometry.exp([0.02, 0, 0.02, 0, 0.004, 0]) @ T, np.diag(np.repeat([0.03, 0.006], 3) ** 2))
    far = Uncertain(T, 1e6 * np.eye(6))
    counts = []
    for prior, radius in ((near, 150.0), (far, 1e6)):
        found, features, _ = matching.search(
            frames[0].features, frames[1].features, prior, CAMERA, MatchingSettings(max_radius=radius), NOISE
        )
        truth = CAMERA.project(geometry.apply(T, frames[0].features.landmarks[found].astype(float)))
        error = np.abs(truth - frames[1].features.measurements[features])[:, :2].max(1)
        counts.append((len(found), int((error > 5).sum())))
    assert counts[0][0] > counts[1][0]
    assert counts[0][1] <= 0.03 * counts[0][0]


def test_refined_matches_are_sub_pixel(frames):
    T = geometry.inverse(T_WORLD_LIVE)
    prior = Uncertain(T, np.diag(np.repeat([0.05, 0.01], 3) ** 2))
    found = matching.match(frames[0].features, frames[1], prior, CAMERA, MatchingSettings(), NOISE)
    truth = CAMERA.project(geometry.apply(T, frames[0].features.landmarks[found.landmarks].astype(float)))
    assert len(found.landmarks) > 60
    assert np.median(np.linalg.norm(found.uvd[:, :2] - truth[:, :2], axis=1)) < 0.2


def test_nothing_is_found_where_nothing_is(frames):
    empty = frames[0].features.select(np.zeros(0, int))
    for a, b in ((empty, frames[1].features), (frames[0].features, empty)):
        found, features, ratios = matching.search(a, b, Uncertain.exactly(np.eye(4)), CAMERA, MatchingSettings(), NOISE)
        assert len(found) == len(features) == len(ratios) == 0
