import cv2
import numpy as np
import pytest

from services.estimator.surf import SurfError
from services.estimator.surf.integral import box_mean, extended, integral


def _random(shape, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (7, 12), (12, 7)])
def test_the_sums_are_those_of_the_image_with_its_margins(shape, wrap):
    image = _random(shape)
    wide = extended(image, 15, 4, wrap=wrap)
    rows = np.clip(np.arange(-4, shape[0] + 4), 0, shape[0] - 1)
    columns = np.arange(-15, shape[1] + 15)
    columns = columns % shape[1] if wrap else np.clip(columns, 0, shape[1] - 1)
    np.testing.assert_array_equal(wide, image[rows][:, columns])
    expected = np.zeros((wide.shape[0] + 1, wide.shape[1] + 1), np.int64)
    expected[1:, 1:] = wide.astype(np.int64).cumsum(axis=0).cumsum(axis=1)
    np.testing.assert_array_equal(integral(wide, 15, 4).sums, expected)


def test_a_box_between_pixels_is_the_mean_of_pixels_as_squares():
    image = _random((20, 24), 1)
    sums = integral(image, 0, 0).sums
    # Edges at quarters of a pixel: the same box, on an image whose pixels are cut into 4x4.
    fine = np.kron(image, np.ones((4, 4)))
    rng = np.random.default_rng(2)
    for _ in range(50):
        left, top = rng.integers(0, 40, 2)
        side = int(rng.integers(1, 20)) * 2
        mean = fine[top : top + side, left : left + side].mean()
        half = side / 8
        assert box_mean(sums, left / 4 + half, top / 4 + half, half) == pytest.approx(mean, abs=1e-9)


@pytest.mark.parametrize(("u", "v"), [(-30.0, 5.0), (80.0, 5.0), (10.0, -25.5), (10.2, 66.0), (-9.0, -9.0)])
def test_outside_the_image_its_outermost_pixels_go_on(u, v):
    image = _random((20, 24), 3)
    wide = cv2.copyMakeBorder(image, 100, 100, 100, 100, cv2.BORDER_REPLICATE)
    far = box_mean(integral(wide, 0, 0).sums, u + 100, v + 100, 6.5)
    assert box_mean(integral(image, 0, 0).sums, u, v, 6.5) == pytest.approx(far, abs=1e-6)


def test_an_image_whose_sums_would_overflow_is_refused():
    with pytest.raises(SurfError, match="too large"):
        extended(np.zeros((4000, 4000), np.uint8), 10, 10, wrap=False)
