"""The horizontal shift between a live and a stored image, with its score and uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.errors import ImageError
from common.registration.correlation import Curve, Prepared, prepare, similarity
from common.registration.gradients import GradientRepresentation
from common.registration.images import Image
from common.registration.representation import Described, Representation

_SAME_SHAPE = 0.01
"""Largest relative difference of two images' aspect ratios that are still one camera's."""

_LOBE = 0.035
"""Half the width of a peak, in widths of the image: another peak is at least so far away."""

_TEMPERATURE = 0.02
"""Difference of similarity that makes a shift e times as likely."""

_PARALLAX = 0.006
"""Standard deviation, in widths of the image, of the shift of one thing from that of another at another distance.

With the temperature it makes errors 0.9 standard deviations (RMS) over a year in a park, and 1.3 over narrow cuts of
the same images; half or one and a half times the temperature does nearly as well.
"""


@dataclass(frozen=True, slots=True)
class Registration:
    """What registering a live image to a stored one gave.

    Attributes:
        shift_px: pixels of the live image, a fraction included; positive when the scene lies further right in it.
        score: similarity at that shift, in [-1, 1], 1 for identical images and 0 where there is nothing to see.
        sigma_px: standard deviation of the shift: that of :meth:`likelihood`, and parallax.
        confidence: by how much the best peak surpasses the second, as a part of it, in [0, 1].
        shifts_px: (n,) all shifts that were tried, ascending.
        curve: (n,) similarity at each.
    """

    shift_px: float
    score: float
    sigma_px: float
    confidence: float
    shifts_px: Curve
    curve: Curve

    def likelihood(self) -> Curve:
        """(n,) how likely each of the shifts is; the sum is 1."""
        return _likelihood(self.curve)


@dataclass(frozen=True, slots=True)
class Registrar:
    """Registers images through a representation.

    Attributes:
        representation: what images become before they are compared.
        max_shift: largest shift that is looked for, in widths of the image.
    """

    representation: Representation = field(default_factory=GradientRepresentation)
    max_shift: float = 0.4

    def prepare(self, image: Image | Described) -> Prepared:
        """What :meth:`register` takes, to be kept where one image is compared with many.

        Raises:
            ImageError: the image cannot be represented.
        """
        described = image if isinstance(image, Described) else self.representation.describe(image)
        return prepare(described)

    def register(self, live: Image | Described | Prepared, stored: Image | Described | Prepared) -> Registration:
        """The shift of the scene from the stored to the live image.

        The images may differ in size, not in shape, and one may be grey.

        Raises:
            ImageError: they cannot be compared.
        """
        a, b = (image if isinstance(image, Prepared) else self.prepare(image) for image in (live, stored))
        _check_pair(a.described, b.described)
        columns = a.described.values.shape[2]
        reach = max(1, int(self.max_shift * columns))
        return _registration(similarity(a, b, reach), columns, a.described.width)


def register(live: Image, stored: Image, representation: Representation | None = None) -> Registration:
    """The shift of the scene from the stored to the live image, each (H, W) or (H, W, 3) RGB.

    Raises:
        ImageError: they cannot be compared.
    """
    return Registrar(representation or GradientRepresentation()).register(live, stored)


def _check_pair(live: Described, stored: Described) -> None:
    if live.name != stored.name:
        raise ImageError(f"a representation by '{live.name}' cannot be compared with one by '{stored.name}'")
    if abs(live.width * stored.height / (live.height * stored.width) - 1.0) > _SAME_SHAPE:
        raise ImageError(
            f"a live image of {live.width}x{live.height} and a stored one of {stored.width}x{stored.height} "
            "differ in shape: crop both to one aspect ratio"
        )
    if (live.values.shape[0], live.values.shape[2]) != (stored.values.shape[0], stored.values.shape[2]):
        raise ImageError(f"representations of {live.values.shape} and {stored.values.shape} cannot be compared")


def _registration(curve: Curve, columns: int, width: int) -> Registration:
    """Peak, fraction and uncertainty of a curve about shift 0; the image's width is so many columns, or pixels."""
    reach, pixels = len(curve) // 2, width / columns
    shifts: Curve = pixels * np.arange(-reach, reach + 1, dtype=np.float64)
    if not curve.any():
        return Registration(0.0, 0.0, _deviation(curve, shifts, 0.0), 0.0, shifts, curve)
    best = int(curve.argmax())
    fraction, score = _vertex(curve, best)
    shift = pixels * (best - reach + fraction)
    others = curve[np.abs(np.arange(len(curve)) - best) > max(1.0, _LOBE * columns)]
    second = float(others.max(initial=0.0))
    confidence = max(0.0, 1.0 - second / score) if score > 0.0 else 0.0
    sigma = float(np.hypot(_deviation(curve, shifts, shift), _PARALLAX * width))
    return Registration(shift, score, sigma, confidence, shifts, curve)


def _vertex(curve: Curve, best: int) -> tuple[float, float]:
    """Place, relative to ``best``, and height of the parabola through the highest value and its two neighbours."""
    if not 0 < best < len(curve) - 1:
        return 0.0, float(curve[best])
    before, peak, after = (float(value) for value in curve[best - 1 : best + 2])
    bend = before - 2.0 * peak + after
    if bend >= 0.0:
        return 0.0, peak
    fraction = 0.5 * (before - after) / bend
    return fraction, min(1.0, peak - 0.25 * (before - after) * fraction)


def _likelihood(curve: Curve) -> Curve:
    weights = np.exp((curve - curve.max()) / _TEMPERATURE)
    likelihood: Curve = weights / weights.sum()
    return likelihood


def _deviation(curve: Curve, shifts: Curve, shift: float) -> float:
    """Root mean square distance from ``shift``, pixels, under the curve's likelihood."""
    return float(np.sqrt(_likelihood(curve) @ (shifts - shift) ** 2))
