"""The illumination-invariant image: what a scene's materials look like whatever light falls on them.

Section III-A of C. McManus et al., *Shady dealings*, ICRA 2014, after S. Ratnasingam and T. McGinnity, *Chromaticity
space for illuminant invariant recognition*, IEEE Trans. Image Processing 21, 2012. For narrow bands and light of black
bodies, three responses make an intensity that depends on the reflectances alone::

    I = log R2 - alpha log R1 - beta log R3                     (1)
    1 / lambda2 = alpha / lambda1 + beta / lambda3              (2)

R2 is green. The paper does not say which of red and blue is R1; its pair (0.4800, 0.5065) satisfies (2) for peaks of
470, 540 and 610 nm, a Bayer sensor's, with R1 blue and R3 red, which is the numbering here.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from common.camera import StereoCamera, Transfer
from common.compiled import kernel
from services.estimator.stereo.settings import InvarianceSettings

Image = NDArray[np.uint8]

PAPER = (0.4800, 0.5065)
"""Alpha and beta of the paper's Point Grey Bumblebee2: those of a colour camera of which nothing is known."""

_FRACTION_BITS = 6
_KERNEL = (5, 5)
"""Size of the smoothing, pixels: enough for the standard deviations that are allowed."""
_NEUTRAL = 128


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Alpha, the weight of blue, and beta, that of red."""

    alpha: float
    beta: float


def coefficients_of(wavelengths: tuple[float, float, float]) -> Coefficients:
    """The pair that satisfies (2) for peaks of red, green and blue, and ``alpha + beta = 1``.

    With that sum a factor common to the three responses, the exposure, cancels as well.

    Raises:
        ValueError: green's peak does not lie between the two others.
    """
    red, green, blue = wavelengths
    if not (min(red, blue) < green < max(red, blue)):
        raise ValueError("the peak wavelength of green must lie between those of red and blue")
    alpha = (1.0 / green - 1.0 / red) / (1.0 / blue - 1.0 / red)
    return Coefficients(alpha, 1.0 - alpha)


def coefficients(camera: StereoCamera, settings: InvarianceSettings) -> Coefficients:
    """The configured pair, else the one of the camera's wavelengths, else the paper's.

    Raises:
        ValueError: the wavelengths are in no order.
    """
    if settings.alpha is not None and settings.beta is not None:
        return Coefficients(settings.alpha, settings.beta)
    if camera.wavelengths is not None:
        return coefficients_of(camera.wavelengths)
    return Coefficients(*PAPER)


def linear_intensities(transfer: Transfer, black_level: float) -> NDArray[np.float64]:
    """Light (256,) that each grey level stands for, as a part of full scale; ``black_level`` is that of no light."""
    level = np.clip((np.arange(256) - black_level) / (255.0 - black_level), 0.0, 1.0)
    if transfer == "srgb":
        # IEC 61966-2-1: linear near black, a power beyond.
        return np.asarray(np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4))
    return np.asarray(level**transfer)


class InvariantTransform:
    """Makes invariant images of colour images, each pixel by itself through a table for each channel."""

    def __init__(self, camera: StereoCamera, settings: InvarianceSettings) -> None:
        """Raises ValueError where the camera's wavelengths are in no order."""
        self.coefficients = coefficients(camera, settings)
        self._smoothing = settings.smoothing
        light = linear_intensities(camera.transfer, settings.black_level)
        logarithm = np.log(light + settings.floor)
        scale = settings.contrast * (1 << _FRACTION_BITS)
        weights = np.array([-self.coefficients.beta, 1.0, -self.coefficients.alpha])
        tables = np.rint(scale * weights[:, None] * (logarithm - logarithm[-1]))
        offset = (_NEUTRAL << _FRACTION_BITS) + (1 << (_FRACTION_BITS - 1))
        tables[1] += offset
        self._tables = np.clip(tables, -(2**30), 2**30).astype(np.int32)

    def __call__(self, image: Image) -> Image:
        """The invariant image (H, W) of a colour image (H, W, 3), RGB, both uint8.

        It has ``settings.contrast`` grey levels a unit of (1), 128 where light is as much in all three channels, and is
        cut off at 0 and 255. The darkest pixels, of which (1) says nothing but noise, fade to 128 by the floor that is
        added to their intensities; saturated ones are 128 where all three channels are saturated.
        """
        out = np.empty(image.shape[:2], np.uint8)
        _transform(self._smooth(image), self._tables, out)
        return self._smooth(out)

    def _smooth(self, image: Image) -> Image:
        """Takes noise off: before the logarithms, which make most of it where it is dark, and once more after them."""
        if self._smoothing == 0.0:
            return np.ascontiguousarray(image)
        return np.asarray(cv2.GaussianBlur(image, _KERNEL, self._smoothing), dtype=np.uint8)


@kernel
def _transform(image: Image, tables: NDArray[np.int32], out: Image) -> None:
    """Sum up the three channels' tables (3, 256) at each pixel."""
    pixels, flat = image.ravel(), out.ravel()
    for k in range(flat.shape[0]):
        value = tables[0, pixels[3 * k]] + tables[1, pixels[3 * k + 1]] + tables[2, pixels[3 * k + 2]]
        flat[k] = min(max(value >> _FRACTION_BITS, 0), 255)
