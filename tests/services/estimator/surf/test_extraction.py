import cv2
import numpy as np
import pytest

from services.estimator.surf import SurfError, SurfFeatures, SurfSettings, detect_and_describe, match
from tests.services.estimator.surf.pictures import texture


def _turn(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def test_features_have_the_promised_shapes_and_order():
    image = texture(0)
    found = detect_and_describe(image, SurfSettings(max_features=200))
    n = len(found)
    assert n == 200
    shapes = {"points": (n, 2), "scales": (n,), "angles": (n,), "laplacians": (n,), "responses": (n,)}
    for name, shape in shapes.items():
        value = getattr(found, name)
        assert value.shape == shape
        assert value.dtype == (np.int8 if name == "laplacians" else np.float32)
    assert found.descriptors.shape == (n, 64)
    assert found.descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1.0, atol=1e-5)
    assert (np.diff(found.responses) <= 0).all()
    assert found.responses.min() >= SurfSettings().hessian_threshold * 0.99
    margin = SurfSettings().margin * found.scales[:, None]
    assert (found.points >= margin - 1e-3).all()
    assert (found.points <= np.array([319, 239]) - margin + 1e-3).all()
    assert set(np.unique(found.laplacians)) == {-1, 1}
    some = found.select(found.scales > 2.0)
    assert 0 < len(some) < n
    np.testing.assert_array_equal(some.descriptors, found.descriptors[found.scales > 2.0])


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_turned_by_quarters_the_same_features_are_found_and_turned(quarters):
    image = texture(1, (257, 257))
    settings = SurfSettings(max_features=300)
    a, b = detect_and_describe(image, settings), detect_and_describe(np.rot90(image, quarters), settings)
    pairs = match(a, b).pairs
    assert len(pairs) > 0.9 * len(a)
    centre = 128.0
    x, y = (a.points[pairs[:, 0]] - centre).T
    expected = {1: (y, -x), 2: (-x, -y), 3: (-y, x)}[quarters]
    np.testing.assert_allclose(b.points[pairs[:, 1]] - centre, np.column_stack(expected), atol=0.05)
    turn = _turn(b.angles[pairs[:, 1]] - a.angles[pairs[:, 0]] + quarters * np.pi / 2)
    assert (np.abs(turn) < 0.02).mean() > 0.98


@pytest.mark.parametrize("degrees", [20.0, -37.0, 45.0, 110.0])
def test_angles_turn_with_the_image(degrees):
    image = texture(2, (320, 320))
    transform = cv2.getRotationMatrix2D((159.5, 159.5), degrees, 1.0)
    turned = cv2.warpAffine(image, transform, (320, 320), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    a, b = detect_and_describe(image), detect_and_describe(turned)
    pairs = match(a, b).pairs
    expected = a.points[pairs[:, 0]] @ transform[:, :2].T + transform[:, 2]
    right = np.linalg.norm(expected - b.points[pairs[:, 1]], axis=1) < 2.5
    assert right.sum() > 150
    assert right.mean() > 0.95
    # The y axis points down, so that counter-clockwise is a negative turn.
    turn = np.rad2deg(_turn(b.angles[pairs[right, 1]] - a.angles[pairs[right, 0]] + np.deg2rad(degrees)))
    assert np.median(np.abs(turn)) < 5.0
    assert abs(np.median(turn)) < 1.5


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 0), (0.5, 100), (1.0, 30), (0.8, -10)])
def test_brightness_and_contrast_leave_the_descriptors(gain, offset):
    image = (60 + texture(3).astype(np.float64) * 0.5).round()
    settings = SurfSettings(hessian_threshold=4.0, max_features=300)
    a = detect_and_describe(image.astype(np.uint8), settings)
    b = detect_and_describe((gain * image + offset).round().astype(np.uint8), settings)
    pairs = match(a, b, ratio=1.0).pairs
    near = np.linalg.norm(a.points[pairs[:, 0]] - b.points[pairs[:, 1]], axis=1) < 0.5
    assert near.sum() > 0.85 * len(a)
    apart = np.linalg.norm(a.descriptors[pairs[near, 0]] - b.descriptors[pairs[near, 1]], axis=1)
    # Grey levels are rounded, nothing else.
    assert np.median(apart) < (1e-5 if gain == 1.0 else 0.06)
    if gain == 1.0:
        np.testing.assert_allclose(b.responses, a.responses, rtol=1e-5)


def test_a_shift_by_pixels_of_all_octaves_changes_nothing_but_the_places():
    big = texture(4, (300, 400))
    settings = SurfSettings(margin=15.0, max_features=10_000)
    a, b = detect_and_describe(big[:, :300], settings), detect_and_describe(big[:, 16:316], settings)
    table = {tuple(np.round(p, 3)): i for i, p in enumerate(b.points + np.float32([16, 0]))}
    same = [(i, table[tuple(np.round(p, 3))]) for i, p in enumerate(a.points) if tuple(np.round(p, 3)) in table]
    inside = (a.points[:, 0] - 16 > 15 * a.scales) & (a.points[:, 0] < 299)
    assert len(same) >= 0.95 * inside.sum()
    i, j = np.array(same).T
    np.testing.assert_allclose(a.descriptors[i], b.descriptors[j], atol=1e-4)
    np.testing.assert_allclose(_turn(a.angles[i] - b.angles[j]), 0.0, atol=1e-4)


@pytest.mark.parametrize("shift", [64, 200, 501])
def test_a_panorama_has_no_seam(shift):
    image = texture(5, (64, 512))
    settings = SurfSettings(max_features=10_000, octaves=3)
    a = detect_and_describe(image, settings, wrap=True)
    b = detect_and_describe(np.roll(image, shift, axis=1), settings, wrap=True)
    # Grids of coarser octaves fall on other pixels where the shift is not a multiple of their steps.
    exact = shift % 4 == 0
    pairs = match(a, b, ratio=1.0).pairs
    apart = (b.points[pairs[:, 1], 0] - a.points[pairs[:, 0], 0] - shift + 256) % 512 - 256
    same = np.abs(apart) < 0.5
    assert same.sum() >= (1.0 if exact else 0.9) * len(a)
    seam = (a.points[pairs[same, 0], 0] < 10) | (a.points[pairs[same, 0], 0] > 501)
    assert seam.sum() > 5
    if exact:
        distances = np.linalg.norm(a.descriptors[pairs[:, 0]] - b.descriptors[pairs[:, 1]], axis=1)
        assert distances.max() < 1e-4
    assert (a.points[:, 0] < 512).all()
    assert (a.points[:, 0] >= 0).all()


def test_a_mask_is_kept_to():
    image = texture(6)
    mask = np.zeros(image.shape, np.uint8)
    mask[50:150, 100:250] = 255
    found = detect_and_describe(image, mask=mask)
    everywhere = detect_and_describe(image)
    assert 20 < len(found) < len(everywhere)
    x, y = np.rint(found.points).astype(int).T
    assert (mask[y, x] == 255).all()
    np.testing.assert_array_equal(detect_and_describe(image, mask=mask > 0).points, found.points)


def test_cells_spread_the_features_over_light_and_shade():
    image = texture(7, (240, 480))
    image[:, 240:] = 100 + image[:, 240:] // 3
    few = {c: detect_and_describe(image, SurfSettings(max_features=150, cell=c)) for c in (None, 40)}
    in_shade = {cell: (found.points[:, 0] > 240).sum() for cell, found in few.items()}
    assert all(len(found) == 150 for found in few.values())
    assert in_shade[40] > 40 > in_shade[None]
    assert (np.diff(few[40].responses) <= 0).all()


def test_upright_features_have_no_angle_and_tell_turned_images_apart():
    image = texture(8, (256, 256))
    upright = SurfSettings(upright=True)
    a = detect_and_describe(image, upright)
    assert (a.angles == 0.0).all()
    again = detect_and_describe(np.ascontiguousarray(image[:, 8:]), upright)
    assert len(match(a, again).pairs) > 0.6 * len(a)
    turned = detect_and_describe(np.rot90(image), upright)
    assert len(match(a, turned).pairs) < 0.1 * len(a)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((100, 120), np.uint8),
        np.full((100, 120), 255, np.uint8),
        np.zeros((0, 0), np.uint8),
        np.zeros((0, 50), np.uint8),
        np.full((1, 1), 7, np.uint8),
        np.random.default_rng(0).integers(0, 255, (8, 8), dtype=np.uint8),
        np.random.default_rng(0).integers(0, 255, (3, 500), dtype=np.uint8),
        np.broadcast_to(np.arange(120, dtype=np.uint8), (100, 120)),
    ],
    ids=["black", "white", "no pixel", "no row", "one pixel", "tiny", "a thread", "a slope"],
)
@pytest.mark.parametrize("wrap", [False, True])
def test_an_image_without_blobs_has_no_features(image, wrap):
    found = detect_and_describe(image, wrap=wrap)
    assert len(found) == 0
    assert found.descriptors.shape == (0, 64)
    assert len(match(found, found).pairs) == 0


def test_noise_of_any_size_yields_finite_features():
    rng = np.random.default_rng(1)
    for shape in [(9, 9), (10, 400), (33, 47), (64, 30), (41, 9)]:
        for wrap in (False, True):
            image = rng.integers(0, 256, shape, dtype=np.uint8)
            found = detect_and_describe(image, SurfSettings(margin=0.0), wrap=wrap)
            for value in (found.points, found.scales, found.angles, found.responses, found.descriptors):
                assert np.isfinite(value).all()
            assert (found.points >= 0).all()
            assert (found.points < np.array(shape[::-1])).all()


@pytest.mark.parametrize(
    ("image", "sentence"),
    [
        (np.zeros((50, 50), np.float32), r"uint8, not float32\(50, 50\)"),
        (np.zeros((50, 50, 3), np.uint8), r"\(50, 50, 3\)"),
        (np.zeros(50, np.uint8), r"\(50,\)"),
        (np.zeros((50, 50), np.uint16), "uint16"),
    ],
)
def test_what_is_no_grey_image_is_refused_in_a_sentence(image, sentence):
    with pytest.raises(SurfError, match=sentence):
        detect_and_describe(image)


@pytest.mark.parametrize("mask", [np.zeros((50, 40), np.uint8), np.zeros((50, 50), np.float32)])
def test_a_mask_that_does_not_fit_is_refused_in_a_sentence(mask):
    with pytest.raises(SurfError, match="the mask must be"):
        detect_and_describe(np.zeros((50, 50), np.uint8), mask=mask)


def test_views_of_other_arrays_will_do():
    image = texture(9)
    strided = np.repeat(image, 2, axis=1)[:, ::2]
    strided.setflags(write=False)
    np.testing.assert_array_equal(detect_and_describe(strided).points, detect_and_describe(image).points)


def test_no_features_are_no_features():
    assert len(SurfFeatures.empty()) == 0
    assert len(SurfFeatures.empty().select(np.zeros(0, np.int64))) == 0
