import cv2
import numpy as np
import pytest

from services.estimator.stereo import fast


def _texture(seed, shape=(120, 160)):
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 1.2)


def _is_corner(image, x, y, threshold):
    circle = [int(image[y + dy, x + dx]) for dx, dy in zip(fast._CIRCLE_X, fast._CIRCLE_Y, strict=True)]
    centre = int(image[y, x])
    for sign in (1, -1):
        marks = [sign * (p - centre) > threshold for p in circle]
        if any(all(marks[(start + i) % 16] for i in range(9)) for start in range(16)):
            return True
    return False


@pytest.mark.parametrize("seed", range(3))
def test_every_corner_satisfies_the_definition_and_none_is_lost(seed):
    image = _texture(seed)
    bound = fast._contrast_bound(image)
    found = {tuple(p) for p in fast.detect(image, 12, cell=40, limit=None)}
    assert found
    for y in range(fast.BORDER, image.shape[0] - fast.BORDER):
        for x in range(fast.BORDER, image.shape[1] - fast.BORDER):
            corner = _is_corner(image, x, y, 12)
            assert not corner or bound[y, x] > 12
            if (x, y) in found:
                assert corner
            elif corner:
                around = [(x + dx, y + dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy]
                assert any(_is_corner(image, *p, 12) for p in around), "only a better neighbour may suppress a corner"


def test_a_limit_spreads_the_corners_over_the_image():
    image = np.full((200, 400), 100, np.uint8)
    image[:, :200] = _texture(1, (200, 200))
    # The right half is in the shade: a tenth of the contrast.
    image[:, 200:] = 100 + _texture(2, (200, 200)) // 5
    places = fast.detect(image, 5, cell=40, limit=120)
    assert len(places) == 120
    assert (places[:, 0] >= 200).sum() > 40


def test_corners_come_in_reading_order_and_keep_off_the_edge():
    places = fast.detect(_texture(3), 8, cell=40, limit=50)
    assert (np.diff(places[:, 1] * 1000 + places[:, 0]) > 0).all()
    assert places.min() >= fast.BORDER
    assert (places < np.array([160, 120]) - fast.BORDER).all()


@pytest.mark.parametrize(
    "image", [np.zeros((100, 100), np.uint8), np.full((100, 100), 255, np.uint8), np.zeros((20, 20), np.uint8)]
)
def test_an_image_without_texture_has_no_corners(image):
    assert fast.detect(image, 10, cell=40, limit=100).shape == (0, 2)
