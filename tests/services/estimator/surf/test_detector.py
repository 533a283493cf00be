import itertools

import numpy as np
import pytest

from services.estimator.surf import SurfSettings, detect_and_describe
from services.estimator.surf.detector import BALANCE, _maxima, _responses
from services.estimator.surf.integral import extended, integral
from services.estimator.surf.octaves import octaves_of, reach_of
from tests.services.estimator.surf.pictures import blob, texture


def _profile(edges, length):
    """Weights (length,) of pixels around the middle, for a list of (from, to, weight) in pixels from its centre."""
    centres = np.arange(length) - length // 2
    weights = np.zeros(length)
    for begin, end, weight in edges:
        weights += weight * np.clip(np.minimum(centres + 0.5, end) - np.maximum(centres - 0.5, begin), 0, 1)
    return weights


def _filters(size):
    """The kernels Dxx and Dxy (2, n, n) as the paper draws them; lobes of an even size end in the middle of pixels."""
    lobe, n = size / 3, 2 * size + 3
    lobes = _profile([(-1.5 * lobe, -0.5 * lobe, 1), (-0.5 * lobe, 0.5 * lobe, -2), (0.5 * lobe, 1.5 * lobe, 1)], n)
    height = _profile([(-lobe + 0.5, lobe - 0.5, 1)], n)
    sides = _profile([(-lobe - 0.5, -0.5, -1), (0.5, lobe + 0.5, 1)], n)
    return np.outer(height, lobes), np.outer(sides, sides)


def _at(image, y, x, kernel):
    n = kernel.shape[0] // 2
    return (image[y - n : y + n + 1, x - n : x + n + 1] * kernel).sum()


@pytest.mark.parametrize(("size", "step"), [(6, 1), (9, 1), (12, 1), (15, 1), (18, 1), (12, 2), (18, 2), (36, 4)])
def test_responses_are_those_of_direct_convolution(size, step):
    image = np.random.default_rng(size).integers(0, 256, (13, 17), dtype=np.uint8)
    pad = 2 * size + 10
    wide = extended(image, pad, pad, wrap=False)
    grid = (-(-13 // step) + 2, -(-17 // step) + 2)
    out = np.empty(grid, np.float32)
    sums = integral(wide, pad, pad)
    _responses(sums.sums, pad, pad, size, step, out)
    k_xx, k_xy = _filters(size)
    for r in range(grid[0]):
        for c in range(grid[1]):
            y, x = pad + (r - 1) * step, pad + (c - 1) * step
            xx, yy, xy = (_at(wide.astype(float), y, x, k) / size**2 for k in (k_xx, k_xx.T, k_xy))
            assert out[r, c] == pytest.approx(xx * yy - (BALANCE * xy) ** 2, rel=1e-4, abs=1e-3)


def test_the_filters_answer_neither_to_brightness_nor_to_a_slope():
    rows, columns = np.mgrid[:60, :60]
    ramp = (2 * columns + rows + 20).astype(np.uint8)
    sums = integral(ramp, 20, 20)
    for size in (6, 9, 12, 18):
        out = np.empty((12, 12), np.float32)
        _responses(sums.sums, 20, 20, size, 1, out)
        np.testing.assert_array_equal(out, 0.0)


def test_maxima_are_those_of_brute_force():
    # Few distinct values, so that there are plateaus.
    stack = np.random.default_rng(4).integers(0, 12, (4, 20, 25)).astype(np.float32)
    found = {tuple(map(int, index)) for index in _maxima(stack, np.full(4, 3.0, np.float32))}
    expected = set()
    for k, r, c in itertools.product(range(1, 3), range(1, 19), range(1, 24)):
        around = stack[k - 1 : k + 2, r - 1 : r + 2, c - 1 : c + 2].ravel()
        # Of equal neighbours only the first may stay: the 14th of 27 is the one in the middle.
        if around[13] > 3.0 and around[13] == around.max() and np.argmax(around) == 13:
            expected.add((k, r, c))
    assert found == expected
    assert len(found) > 10


@pytest.mark.parametrize("sigma", [1.6, 2.3, 3.7, 6.0, 9.5])
@pytest.mark.parametrize("height", [120.0, -45.0])
def test_a_spot_is_found_at_its_place_and_size(sigma, height):
    x, y = 101.3, 77.8
    found = detect_and_describe(blob((160, 200), x, y, sigma, height, 100.0), SurfSettings(max_features=1))
    assert len(found) == 1
    np.testing.assert_allclose(found.points[0], (x, y), atol=0.1 * sigma)
    assert found.laplacians[0] == (-1 if height > 0 else 1)
    # The boxes' determinant is largest where the scale by which the paper calls them is 0.7 of the spot's.
    assert found.scales[0] == pytest.approx(0.7 * sigma, rel=0.06)


def test_octaves_follow_each_other_and_fit_into_the_image():
    octaves = octaves_of(480, 640, 4, 4)
    assert [octave.sizes for octave in octaves[:2]] == [(6, 9, 12, 18), (12, 18, 24, 36)]
    assert [octave.step for octave in octaves] == [1, 2, 4, 8]
    assert len(octaves_of(64, 1024, 4, 4)) == 3
    assert octaves_of(8, 1024, 4, 4) == []
    assert reach_of(octaves) > octaves[-1].sizes[-1] / 2


@pytest.mark.parametrize("layers", [3, 4, 5])
def test_every_number_of_layers_finds_features(layers):
    found = detect_and_describe(texture(1), SurfSettings(layers=layers))
    assert len(found) > 100
    sizes = [octave.sizes for octave in octaves_of(240, 320, 4, layers)]
    assert all(len(set(s)) == layers and list(s) == sorted(s) for s in sizes)
