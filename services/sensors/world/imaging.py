"""From light to pixels: exposure, noise, saturation and the transfer curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Array
from services.sensors.world.geometry import Floats
from services.sensors.world.kernel import kernel
from services.sensors.world.settings import ImagingSettings

Image = NDArray[np.uint8]
_NOISE = 1 << 18
_CURVE = 4096


class Imager:
    """A pair of cameras with one exposure, which follows the mean grey level slowly."""

    def __init__(self, settings: ImagingSettings, white: float, seed: int) -> None:
        """``white`` is the light of a white surface in clear noon sun, which gain 1 just saturates."""
        self._settings, self._white = settings, white
        self._rng = np.random.default_rng(seed)
        self._noise = self._rng.standard_normal(_NOISE).astype(np.float32)
        grey = np.arange(_CURVE) / (_CURVE - 1.0)
        self._curve = np.rint(255.0 * grey ** (1.0 / settings.gamma)).astype(np.uint8)
        self.gain: float | None = None

    def meter(self, light: Floats, seconds: float) -> None:
        """Move the gain towards the exposure that ``light`` (H, W, 3) below its upper third, mostly sky, asks for.

        ``seconds`` have passed since the last time; the first call sets it at once. Saturated
        light counts as full scale, as it does for a real camera.
        """
        s = self._settings
        thin = light[light.shape[0] // 3 :: 8, ::8] / np.float32(self._white)
        wanted = s.target / max(float(thin.mean()), 1e-12)
        for _ in range(4):
            wanted *= s.target / max(float(np.minimum(thin * wanted, 1.0).mean()), 1e-12)
        wanted = min(wanted, s.gain_limit)
        if self.gain is None:
            self.gain = wanted
        else:
            follow = 1.0 - np.exp(-max(seconds, 0.0) / s.exposure_seconds)
            self.gain *= float((wanted / self.gain) ** follow)

    def expose(self, light: Floats) -> Image:
        """The image (H, W, 3) of light (H, W, 3) at the present gain.

        Raises:
            RuntimeError: nothing was metered yet.
        """
        if self.gain is None:
            raise RuntimeError("an image needs an exposure: meter the light first")
        s = self._settings
        image = np.empty(light.shape, np.uint8)
        scale = self.gain / self._white
        # A higher gain collects fewer electrons for the same grey level.
        per_electron = max(self.gain, 1.0) / s.full_well
        rows = light.reshape(light.shape[0], -1)
        offsets = self._rng.integers(0, _NOISE - rows.shape[1], size=(light.shape[0],))
        levels = np.empty(rows.shape[1], np.float32)
        read = s.read_noise * per_electron
        _expose(rows, scale, per_electron, read, self._noise, offsets, self._curve, levels, image.reshape(rows.shape))
        return image


@kernel
def _expose(
    light: Floats,
    scale: float,
    shot: float,
    read: float,
    noise: Floats,
    offsets: NDArray[np.int64],
    curve: Image,
    levels: Floats,
    image: Image,
) -> None:
    """Grey levels of light (H, W*3): variance ``shot * level + read^2`` in parts of full scale."""
    height, width = light.shape
    gain, per_level, floor = np.float32(scale), np.float32(shot), np.float32(read * read)
    top, half = np.float32(len(curve) - 1), np.float32(0.5)
    for row in range(height):
        first = offsets[row]
        # Apart from the table's look-up, so that this loop is compiled to vector instructions.
        for k in range(width):
            level = light[row, k] * gain
            level += np.sqrt(per_level * level + floor) * noise[first + k]
            levels[k] = min(max(level, np.float32(0.0)), np.float32(1.0)) * top + half
        for k in range(width):
            image[row, k] = curve[np.int32(levels[k])]


def response_white(sun: Array, sky: Array) -> float:
    """The light of a white surface under sun and sky (3,), (3,), by the brightest band."""
    return float((sun + sky).max())
