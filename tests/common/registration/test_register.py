"""Shifts that are known, seen in other light, at other sizes, and where there is nothing to see."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import ImageError
from common.registration import GradientRepresentation, Registrar, register
from common.registration.correlation import prepare, similarity
from common.registration.representation import Described
from tests.common.registration.scenes import HEIGHT, WIDTH, panorama, window

SCENE = panorama()


def pair(shift, **live):
    """A live image in which the scene lies ``shift`` pixels further right than in the stored one."""
    return window(SCENE, 400 - shift, **live), window(SCENE, 400)


@settings(max_examples=25)
@given(st.floats(-150, 150))
def test_a_known_shift_is_found_to_a_fraction_of_a_pixel_positive_to_the_right(shift):
    result = register(*pair(shift))
    assert abs(result.shift_px - shift) < 0.3
    # What one image shows and the other does not, up to 30 % here, takes a part of the likeness.
    assert result.score > 0.95 - 0.1 * abs(shift) / 150
    assert result.confidence > 0.5


def test_an_image_is_itself_unshifted():
    result = register(SCENE[:, :WIDTH].astype(np.uint8), SCENE[:, :WIDTH].astype(np.uint8))
    assert abs(result.shift_px) < 0.01
    assert result.score == pytest.approx(1.0, abs=1e-3)


@settings(max_examples=10)
@given(st.integers(-120, 120), st.integers(0, 5))
def test_swapping_live_and_stored_turns_the_sign(shift, seed):
    scene = panorama(seed)
    live, stored = window(scene, 400 - shift), window(scene, 400)
    there, back = register(live, stored), register(stored, live)
    assert there.shift_px == pytest.approx(-back.shift_px, abs=0.01)
    assert there.score == pytest.approx(back.score, abs=1e-4)


@pytest.mark.parametrize(
    "change",
    [
        lambda image: (image * 0.3).astype(np.uint8),
        lambda image: (255 * (image / 255.0) ** 2.5).astype(np.uint8),
        lambda image: 255 - image,
        lambda image: cv2.GaussianBlur(image, (0, 0), 2.0),
        lambda image: np.clip(image + np.random.default_rng(1).normal(0, 12, image.shape), 0, 255).astype(np.uint8),
        lambda image: np.clip(image * np.linspace(0.2, 1.6, image.shape[1]), 0, 255).astype(np.uint8),
    ],
    ids=["dark", "gamma", "negative", "blur", "noise", "sun to one side"],
)
def test_light_moves_nothing(change):
    live, stored = pair(47)
    assert abs(register(change(live), stored).shift_px - 47) < 2.0


def test_a_camera_that_pitches_or_stands_nearer_is_still_found():
    assert abs(register(pair(60, top=18)[0], pair(60)[1]).shift_px - 60) < 3.0
    live, stored = pair(0)
    nearer = cv2.warpAffine(live, np.array([[1.06, 0, -0.03 * WIDTH], [0, 1.06, -0.03 * HEIGHT]]), (WIDTH, HEIGHT))
    assert abs(register(nearer, stored).shift_px) < 5.0


def test_images_of_other_sizes_are_compared_in_the_live_images_pixels():
    live, stored = pair(80)
    half = cv2.resize(live, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    assert abs(register(half, stored).shift_px - 40) < 1.0
    assert abs(register(live, half).shift_px) < 1.0


def test_grey_and_colour_mix():
    live, stored = pair(30)
    colour = cv2.cvtColor(live, cv2.COLOR_GRAY2RGB)
    assert register(colour, stored).shift_px == pytest.approx(register(live, stored).shift_px, abs=0.01)


def test_other_shapes_other_types_and_tiny_images_are_refused():
    live, stored = pair(0)
    with pytest.raises(ImageError, match=r"512x192.*512x100"):
        register(live, stored[:100])
    with pytest.raises(ImageError, match="float64"):
        register(live.astype(float), stored)
    with pytest.raises(ImageError, match="4x4"):
        register(live, stored[:4, :4])
    with pytest.raises(ImageError, match="narrow"):
        register(np.zeros((2000, 20), np.uint8), stored)


@pytest.mark.parametrize("blank", [0, 255])
def test_where_there_is_nothing_to_see_the_score_is_nought_and_the_uncertainty_wide(blank):
    nothing = np.full((HEIGHT, WIDTH), blank, np.uint8)
    result = register(nothing, pair(0)[1])
    assert (result.shift_px, result.score, result.confidence) == (0.0, 0.0, 0.0)
    assert result.sigma_px > 0.2 * WIDTH
    assert np.isfinite(result.curve).all()


def test_another_place_scores_lower_and_is_less_sure():
    same = register(*pair(20))
    other = register(window(panorama(7), 300), pair(20)[1])
    assert other.score < 0.5 * same.score
    assert other.confidence < same.confidence
    assert other.sigma_px > 3 * same.sigma_px


def test_the_curve_holds_every_shift_and_its_likelihood_sums_to_one():
    result = register(*pair(-64))
    assert result.curve.shape == result.shifts_px.shape
    assert result.shifts_px[0] == -result.shifts_px[-1]
    assert result.shifts_px[-1] == pytest.approx(0.4 * WIDTH, abs=2.0)
    assert result.likelihood().sum() == pytest.approx(1.0)
    assert abs(result.shifts_px[result.curve.argmax()] + 64) <= 2.0


def test_what_was_prepared_once_gives_the_same():
    registrar = Registrar()
    live, stored = pair(33)
    assert registrar.register(live, registrar.prepare(stored)).shift_px == registrar.register(live, stored).shift_px


def test_a_representation_of_other_settings_is_refused():
    stored = Described(np.zeros((6, 16, 256), np.float32), WIDTH, HEIGHT, 0.02, "something-else")
    with pytest.raises(ImageError, match="something-else"):
        Registrar().register(pair(0)[0], stored)


def test_the_similarity_is_the_inner_product_of_the_overlap():
    random = np.random.default_rng(3)
    a, b = (Described(random.normal(size=(3, 1, 20)).astype(np.float32), 20, 20, 1.0, "x") for _ in range(2))
    curve = similarity(prepare(a), prepare(b), 8)
    fade = np.sqrt(np.sin(np.pi * (np.arange(20) + 0.5) / 20))
    p, q = ((d.values - d.values.mean(axis=2, keepdims=True)) * fade for d in (a, b))
    for shift, value in zip(range(-8, 9), curve, strict=True):
        left, right = (p[..., shift:], q[..., : 20 - shift]) if shift >= 0 else (p[..., :shift], q[..., -shift:])
        assert value == pytest.approx((left * right).sum() / np.sqrt((left**2).sum() * (right**2).sum()), abs=1e-5)


def test_the_best_vertical_offset_counts():
    random = np.random.default_rng(4)
    values = random.normal(size=(2, 9, 64)).astype(np.float32)
    a = prepare(Described(values, 64, 64, 0.02, "x"))
    b = prepare(Described(np.roll(values, 2, axis=1), 64, 64, 0.02, "x"))
    assert similarity(a, b, 5).argmax() == 5
    assert similarity(a, b, 5)[5] > 0.7


def test_a_stored_representation_takes_a_byte_a_value_and_moves_nothing():
    live, stored = pair(71.3)
    described = GradientRepresentation().describe(stored)
    arrays = described.to_arrays()
    assert sum(array.nbytes for array in arrays.values()) < 40_000
    back = Described.from_arrays(arrays)
    assert (back.width, back.height, back.name) == (WIDTH, HEIGHT, described.name)
    assert abs(register(live, stored).shift_px - Registrar().register(live, back).shift_px) < 0.05


@pytest.mark.parametrize("broken", ["values", "geometry", "name"])
def test_arrays_that_hold_no_representation_are_refused(broken):
    arrays = GradientRepresentation().describe(pair(0)[0]).to_arrays()
    with pytest.raises(ImageError, match="hold no representation"):
        Described.from_arrays({name: array for name, array in arrays.items() if name != broken})
    arrays[broken] = np.zeros(2, np.uint8) if broken != "name" else np.full(2, 0xFF, np.uint8)
    with pytest.raises(ImageError, match="hold no representation"):
        Described.from_arrays(arrays)


def test_snow_is_registered_to_autumn(data_dir):
    folder = data_dir / "grief_stromovka_monthly"
    truth = np.loadtxt(folder / "ground_truth" / "location_4.txt")
    stored, live = (
        cv2.cvtColor(cv2.imread(str(folder / "images" / f"{session:02d}04.webp")), cv2.COLOR_BGR2RGB)
        for session in (1, 4)
    )
    assert abs(register(live, stored).shift_px - truth[0, 3]) < 10
