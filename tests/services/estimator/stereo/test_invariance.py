"""The invariant image keeps what a surface is made of and forgets what light falls on it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from common.camera import StereoCamera
from services.estimator.stereo.invariance import (
    PAPER,
    InvariantTransform,
    coefficients,
    coefficients_of,
    linear_intensities,
)
from services.estimator.stereo.settings import InvarianceSettings
from services.sensors.world.spectra import planck

PEAKS = (610e-9, 540e-9, 460e-9)
CAMERA = StereoCamera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.2, wavelengths=PEAKS)
SHARP = InvarianceSettings(smoothing=0.0, floor=1e-6)


def transform(camera=CAMERA, settings=SHARP):
    return InvariantTransform(camera, settings)


def test_the_papers_pair_satisfies_its_constraint_for_a_bayer_sensor():
    alpha, beta = PAPER
    assert alpha / 470e-9 + beta / 610e-9 == pytest.approx(1 / 540e-9, rel=3e-4)


@given(st.floats(410e-9, 500e-9), st.floats(510e-9, 570e-9), st.floats(580e-9, 700e-9))
def test_derived_pairs_satisfy_the_constraint_and_add_up_to_one(blue, green, red):
    pair = coefficients_of((red, green, blue))
    assert pair.alpha + pair.beta == pytest.approx(1.0)
    assert pair.alpha / blue + pair.beta / red == pytest.approx(1 / green)


def test_the_configured_pair_comes_first_then_the_wavelengths_then_the_papers():
    configured = InvarianceSettings(alpha=0.3, beta=0.5)
    assert coefficients(CAMERA, configured).alpha == 0.3
    assert coefficients(CAMERA, SHARP).alpha == pytest.approx(0.3975, abs=1e-4)
    unknown = coefficients(replace(CAMERA, wavelengths=None), SHARP)
    assert (unknown.alpha, unknown.beta) == PAPER
    with pytest.raises(ValueError, match="green"):
        coefficients(replace(CAMERA, wavelengths=(540e-9, 610e-9, 460e-9)), SHARP)


def test_a_pixel_is_the_papers_first_equation():
    rng = np.random.default_rng(0)
    image = rng.integers(60, 250, (48, 64, 3), dtype=np.uint8)
    settings = replace(SHARP, contrast=100.0)
    made = transform(settings=settings)
    red, green, blue = (np.log(image[..., k] / 255.0) for k in range(3))
    expected = green - made.coefficients.alpha * blue - made.coefficients.beta * red
    assert np.abs(np.clip(128 + 100.0 * expected, 0, 255) - made(image)).max() <= 1.0


def test_the_exposure_cancels():
    image = np.random.default_rng(1).integers(60, 120, (48, 64, 3), dtype=np.uint8)
    once, twice = (transform()(im).astype(int) for im in (image, 2 * image))
    assert np.abs(once - twice).max() <= 1


def lit(reflectance, temperature, strength):
    """What infinitely narrow bands see of reflectances (..., 3) in a black body's light, as grey levels."""
    light = np.array([planck(peak, temperature) for peak in PEAKS])
    return np.rint(np.clip(reflectance * light / light.max() * strength * 255.0, 0, 255)).astype(np.uint8)


def test_sun_and_shade_give_one_image_where_grey_gives_two():
    reflectance = np.random.default_rng(2).uniform(0.4, 0.9, (48, 64, 3))
    sun, shade = lit(reflectance, 5500.0, 1.0), lit(reflectance, 12000.0, 0.5)
    invariant = transform(settings=replace(SHARP, contrast=200.0))
    difference = np.abs(invariant(sun).astype(int) - invariant(shade).astype(int))
    assert np.percentile(difference, 95) <= 4
    assert np.abs(sun.astype(int) - shade.astype(int)).mean() > 60


@pytest.mark.parametrize("transfer", ["srgb", 2.2])
def test_a_transfer_curve_is_undone(transfer):
    linear = np.random.default_rng(3).uniform(0.3, 0.9, (48, 64, 3))
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    curved = curve if transfer == "srgb" else linear ** (1 / transfer)
    images = [np.rint(255 * x).astype(np.uint8) for x in (linear, curved)]
    made = transform()(images[0]), transform(replace(CAMERA, transfer=transfer))(images[1])
    assert np.percentile(np.abs(made[0].astype(int) - made[1].astype(int)), 95) <= 4


def test_black_is_where_the_camera_says():
    light = linear_intensities(1.0, 16.0)
    assert light[:17].max() == 0.0
    assert light[255] == 1.0


@given(arrays.arrays(np.uint8, (8, 9, 3)))
def test_any_image_gives_one_of_the_same_size(image):
    assert transform(settings=InvarianceSettings())(image).shape == (8, 9)


def test_black_and_saturated_pixels_are_neutral_and_darkness_fades_to_neutral():
    made = transform(settings=InvarianceSettings(smoothing=0.0))
    image = np.zeros((3, 4, 3), np.uint8)
    image[1] = 255
    image[2] = (4, 1, 2)
    out = made(image)
    assert (out[:2] == 128).all()
    bright = np.full((3, 4, 3), (200, 50, 100), np.uint8)
    assert abs(int(out[2, 0]) - 128) < abs(int(made(bright)[0, 0]) - 128)


def test_a_view_of_a_message_is_taken_as_it_is():
    image = np.random.default_rng(4).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    image.setflags(write=False)
    assert transform()(image).shape == (48, 64)
