import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.estimator.surf import SurfError, SurfFeatures, SurfSettings, Window, match

WIDE = SurfSettings(ratio=1.0, max_distance=2.0)


def _features(seed, n, size=(200.0, 100.0)):
    rng = np.random.default_rng(seed)
    # Few directions, so that there are near and far neighbours.
    descriptors = rng.normal(size=(n, 64)) * np.linspace(1.0, 0.0, 64) ** 4
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    ones = np.ones(n, np.float32)
    signs = rng.choice(np.array([-1, 1], np.int8), n)
    points = rng.uniform((0, 0), size, (n, 2)).astype(np.float32)
    return SurfFeatures(points, ones, ones, signs, ones, descriptors.astype(np.float32))


def _brute_force(a, b, allowed, ratio, mutual, max_distance):
    distance = np.linalg.norm(a.descriptors[:, None].astype(float) - b.descriptors[None], axis=2)
    distance[(a.laplacians[:, None] != b.laplacians[None]) | ~allowed] = np.inf
    pairs = []
    for i, row in enumerate(distance):
        j = int(row.argmin())
        second = np.partition(row, 1)[1] if len(row) > 1 else np.inf
        near = np.isfinite(row[j]) and row[j] <= min(max_distance, ratio * second)
        if near and (not mutual or distance[:, j].argmin() == i):
            pairs.append((i, j))
    return pairs


@given(st.integers(0, 10_000), st.integers(1, 40), st.integers(1, 40), st.sampled_from([0.7, 0.9, 1.0]), st.booleans())
@settings(max_examples=40)
def test_matches_are_those_of_brute_force(seed, n, m, ratio, mutual):
    a, b = _features(seed, n), _features(seed + 1, m)
    everywhere = np.ones((n, m), bool)
    found = match(a, b, SurfSettings(max_distance=1.1), ratio=ratio, mutual=mutual)
    assert [tuple(p) for p in found.pairs] == _brute_force(a, b, everywhere, ratio, mutual, 1.1)
    exact = np.linalg.norm(a.descriptors[found.pairs[:, 0]] - b.descriptors[found.pairs[:, 1]], axis=1)
    np.testing.assert_allclose(found.distances, exact, atol=2e-3)
    assert found.pairs.dtype == np.int64
    assert found.pairs.shape == (len(found.distances), 2)


@pytest.mark.parametrize("width", [None, 200.0])
@pytest.mark.parametrize("mutual", [False, True])
def test_windows_are_a_mask_of_what_lies_in_them(width, mutual):
    a, b = _features(1, 60), _features(2, 80)
    predicted = a.points + np.random.default_rng(3).normal(0, 20, a.points.shape)
    predicted[5] = np.nan
    reach = np.random.default_rng(4).uniform(5, 40, predicted.shape)
    apart = b.points[None].astype(float) - predicted[:, None]
    if width is not None:
        apart[..., 0] -= width * np.round(apart[..., 0] / width)
    mask = (np.abs(apart) <= reach[:, None]).all(axis=2)
    by_window = match(a, b, WIDE, mutual=mutual, ratio=0.95, candidates=Window(predicted, reach, width))
    by_mask = match(a, b, WIDE, mutual=mutual, ratio=0.95, candidates=mask)
    assert len(by_window.pairs) > 5
    np.testing.assert_array_equal(by_window.pairs, by_mask.pairs)
    np.testing.assert_allclose(by_window.distances, by_mask.distances, atol=1e-3)
    assert 5 not in by_window.pairs[:, 0]


def test_one_reach_serves_all_windows_and_a_lone_candidate_needs_no_second():
    a, b = _features(1, 30), _features(2, 30)
    b = SurfFeatures(a.points, b.scales, b.angles, a.laplacians, b.responses, b.descriptors)
    found = match(a, b, WIDE, ratio=0.5, candidates=Window(a.points, (0.01, 0.01)))
    np.testing.assert_array_equal(found.pairs, np.column_stack([np.arange(30), np.arange(30)]))


def test_what_is_too_far_or_of_the_other_sign_does_not_match():
    a = _features(1, 20)
    assert len(match(a, a).pairs) == 20
    opposite = SurfFeatures(a.points, a.scales, a.angles, -a.laplacians, a.responses, a.descriptors)
    only_one = a.select(np.array([0]))
    assert len(match(only_one, opposite.select(np.array([0]))).pairs) == 0
    far = SurfFeatures(a.points, a.scales, a.angles, a.laplacians, a.responses, -a.descriptors)
    assert len(match(only_one, far.select(np.array([0]))).pairs) == 0


def test_no_features_have_no_matches():
    a, none = _features(1, 5), SurfFeatures.empty()
    for pair in ((a, none), (none, a), (none, none)):
        found = match(*pair)
        assert found.pairs.shape == (0, 2)
        assert found.distances.shape == (0,)


def test_candidates_that_do_not_fit_are_refused_in_a_sentence():
    a, b = _features(1, 5), _features(2, 6)
    with pytest.raises(SurfError, match=r"must be \(5, 6\)"):
        match(a, b, candidates=np.ones((6, 5), bool))
    with pytest.raises(SurfError, match=r"must be \(5, 2\)"):
        match(a, b, candidates=Window(np.zeros((4, 2)), (1.0, 1.0)))
