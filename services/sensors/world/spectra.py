"""Light by wavelength: black bodies, what materials reflect, and what a camera's bands make of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from common.geometry import Array
from services.sensors.world.settings import BandSettings

WAVELENGTHS: Array = np.arange(380e-9, 731e-9, 10e-9)
"""Where spectra are sampled, metres."""
_STEP = 10e-9
_C2 = 1.438776877e-2
"""Second radiation constant h c / k, metre kelvin."""


def planck(wavelength: ArrayLike, temperature: float) -> Array:
    """Spectral radiance (...) of a black body, in arbitrary units, at wavelengths (...) in metres, kelvin."""
    wavelength = np.asarray(wavelength, dtype=np.float64)
    # In micrometres, so that the fifth power stays near one.
    return np.asarray((wavelength * 1e6) ** -5.0 / np.expm1(_C2 / (wavelength * temperature)))


def illuminant(temperature: float, irradiance: float) -> Array:
    """Spectrum (L,) of a black body over :data:`WAVELENGTHS` whose sum is ``irradiance``."""
    spectrum = planck(WAVELENGTHS, temperature)
    return np.asarray(spectrum * (irradiance / spectrum.sum()))


def band_sensitivities(bands: BandSettings) -> Array:
    """Sensitivities (3, L) of red, green and blue; each sums to one.

    A band narrower than the sampling is the nearest wavelengths' interpolation, so that a width of zero
    measures at the peak alone.

    Raises:
        ValueError: a peak is outside of the sampled wavelengths, or a width is negative.
    """
    peaks, widths = np.array(bands.peaks), np.array(bands.widths)
    if (peaks < WAVELENGTHS[0]).any() or (peaks > WAVELENGTHS[-1]).any():
        raise ValueError(f"band peaks must lie between {WAVELENGTHS[0]:.3g} and {WAVELENGTHS[-1]:.3g} m")
    if (widths < 0.0).any():
        raise ValueError("band widths must not be negative")
    offset = WAVELENGTHS - peaks[:, None]
    sigma = np.maximum(widths, 1e-12)[:, None] / (2.0 * np.sqrt(2.0 * np.log(2.0)))
    gaussian = np.exp(-0.5 * (offset / sigma) ** 2)
    narrow = np.maximum(0.0, 1.0 - np.abs(offset) / _STEP)
    rows = np.where((widths < _STEP)[:, None], narrow, gaussian)
    return np.asarray(rows / rows.sum(axis=1, keepdims=True))


def responses(reflectances: Array, light: Array, sensitivities: Array) -> Array:
    """What bands of sensitivities (3, L) see of reflectances (..., L) in a light (L,): (..., 3)."""
    return np.asarray((reflectances * light) @ sensitivities.T)


def _step(centre: float, width: float) -> Array:
    """A smooth rise (L,) from 0 to 1 at ``centre``, nanometres, over ``width``."""
    return np.asarray(1.0 / (1.0 + np.exp(-(WAVELENGTHS * 1e9 - centre) / width)))


def _bump(centre: float, width: float) -> Array:
    """A bell (L,) of height 1 at ``centre``, nanometres."""
    return np.asarray(np.exp(-0.5 * ((WAVELENGTHS * 1e9 - centre) / width) ** 2))


def _leaf(green: float, base: float) -> Array:
    """Chlorophyll: dark in blue and red, a green peak at 550 nm, the red edge beyond 690 nm."""
    return base + green * _bump(552.0, 32.0) + 0.35 * _step(712.0, 9.0)


_SLOPE = (WAVELENGTHS - 380e-9) / 350e-9

ENDMEMBERS: dict[str, Array] = {
    "grass": _leaf(0.13, 0.045),
    "dry grass": 0.10 + 0.30 * _SLOPE,
    "soil": 0.09 + 0.20 * _SLOPE**1.3,
    "stone": 0.22 + 0.08 * _SLOPE,
    "leaf": _leaf(0.12, 0.035),
    "young leaf": _leaf(0.20, 0.06) + 0.05 * _step(520.0, 15.0),
    "withered leaf": 0.04 + 0.26 * _step(575.0, 30.0),
    "shade": 0.02 + 0.01 * _SLOPE,
    "bark": 0.07 + 0.13 * _SLOPE,
    "lichen": 0.22 + 0.16 * _bump(570.0, 80.0),
    "brick": 0.07 + 0.30 * _step(590.0, 18.0),
    "mortar": 0.34 + 0.14 * _SLOPE,
    "plaster": 0.56 + 0.14 * _SLOPE,
    "ochre": 0.15 + 0.42 * _step(525.0, 25.0),
    "wood": 0.13 + 0.28 * _SLOPE,
    "blue paint": 0.07 + 0.28 * _bump(460.0, 45.0),
    "red paint": 0.05 + 0.45 * _step(605.0, 10.0),
    "glass": 0.07 + 0.02 * _SLOPE,
    "slate": 0.10 + 0.02 * _SLOPE,
    "white paint": np.full_like(_SLOPE, 0.72),
}
"""Reflectance (L,) by name over :data:`WAVELENGTHS`, in the shape of the USGS spectral library's plants and soils."""

NEAR_INFRARED: dict[str, float] = {
    "grass": 0.50,
    "dry grass": 0.44,
    "soil": 0.27,
    "stone": 0.33,
    "leaf": 0.48,
    "young leaf": 0.56,
    "withered leaf": 0.38,
    "shade": 0.06,
    "bark": 0.30,
    "lichen": 0.48,
    "brick": 0.40,
    "mortar": 0.52,
    "plaster": 0.72,
    "ochre": 0.63,
    "wood": 0.55,
    "blue paint": 0.25,
    "red paint": 0.66,
    "glass": 0.05,
    "slate": 0.12,
    "white paint": 0.76,
}
"""Reflectance by name at 850 to 910 nm, where lidars measure: leaves are bright, and what is black stays so."""

MATERIALS: tuple[tuple[str, tuple[str, str, str, str]], ...] = (
    ("ground", ("grass", "dry grass", "soil", "stone")),
    ("bark", ("bark", "wood", "lichen", "shade")),
    ("foliage", ("leaf", "young leaf", "withered leaf", "shade")),
    ("brick", ("brick", "mortar", "withered leaf", "shade")),
    ("plaster", ("plaster", "ochre", "soil", "stone")),
    ("planks", ("wood", "dry grass", "blue paint", "red paint")),
    ("fittings", ("glass", "slate", "white paint", "blue paint")),
    ("rock", ("stone", "lichen", "soil", "grass")),
)
"""Each material mixes four endmembers; its index is what :meth:`World.cast_rays` gives."""

MATERIAL_INDEX: dict[str, int] = {name: i for i, (name, _) in enumerate(MATERIALS)}
REFLECTANCES: Array = np.array([[ENDMEMBERS[e] for e in members] for _, members in MATERIALS])
"""(M, 4, L) of :data:`MATERIALS`."""
REFLECTANCES_INFRARED: Array = np.array([[NEAR_INFRARED[e] for e in members] for _, members in MATERIALS])
"""(M, 4) of :data:`MATERIALS` for a lidar."""
