from __future__ import annotations

import numpy as np
import pytest

from services.sensors.world.settings import BandSettings
from services.sensors.world.spectra import (
    REFLECTANCES,
    WAVELENGTHS,
    band_sensitivities,
    illuminant,
    planck,
    responses,
)


def test_planck_has_wiens_maximum_and_the_right_ratio():
    wavelengths = np.arange(300e-9, 1200e-9, 1e-9)
    for temperature in (3000.0, 5500.0):
        assert wavelengths[planck(wavelengths, temperature).argmax()] == pytest.approx(2.898e-3 / temperature, abs=2e-9)
    # exp(c2 / (lambda T)) is 186.7 at 550 nm and 5000 K, and 13.67 at 10000 K.
    ratio = planck(550e-9, 10000.0) / planck(550e-9, 5000.0)
    assert ratio == pytest.approx(
        (np.exp(1.438777e-2 / (550e-9 * 5000)) - 1) / (np.exp(1.438777e-2 / (550e-9 * 1e4)) - 1), rel=1e-5
    )


def test_every_reflectance_is_between_nothing_and_everything():
    assert (REFLECTANCES > 0.0).all()
    assert (REFLECTANCES < 1.0).all()


def test_shade_is_bluer_than_sun():
    bands = band_sensitivities(BandSettings())
    grey = np.full((1, len(WAVELENGTHS)), 0.5)
    sun = responses(grey, illuminant(5400.0, 900.0), bands)[0]
    sky = responses(grey, illuminant(12000.0, 120.0), bands)[0]
    assert sky[2] / sky[0] > 1.4 * sun[2] / sun[0]


def test_invariant_is_exact_for_narrow_bands_and_imperfect_for_wide_ones():
    """Equations 1-6 of the illumination-invariant transform: the black body's temperature drops out."""
    peaks = np.array([610e-9, 540e-9, 460e-9])
    alpha = (1 / peaks[1] - 1 / peaks[2]) / (1 / peaks[0] - 1 / peaks[2])

    def change(widths):
        bands = band_sensitivities(BandSettings(tuple(peaks), widths))
        light = [
            responses(REFLECTANCES.reshape(-1, len(WAVELENGTHS)), illuminant(t, 1.0), bands) for t in (4000.0, 12000.0)
        ]
        invariant = [np.log(i[:, 1]) - alpha * np.log(i[:, 0]) - (1 - alpha) * np.log(i[:, 2]) for i in light]
        return np.abs(invariant[1] - invariant[0]).max()

    assert change((0.0, 0.0, 0.0)) < 0.01
    assert 0.02 < change((70e-9, 75e-9, 65e-9)) < 0.4


def test_bands_outside_of_the_spectrum_are_refused():
    with pytest.raises(ValueError, match="between"):
        band_sensitivities(BandSettings(peaks=(900e-9, 540e-9, 460e-9)))
