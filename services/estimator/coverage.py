"""How much of a drive was localized, and how far it went on dead reckoning where it was not.

The measures of McManus et al., *Shady Dealings: Robust, Long-Term Visual Localisation using Illumination Invariance*
(ICRA 2014): coverage as in Table I, distances on dead reckoning as in Figure 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def dropouts(success: ArrayLike, distance: ArrayLike) -> Array:
    """Metres on dead reckoning (D,), one for each stretch of failures: from its first failure to the next success.

    ``success`` (N,) says which frames were localized, ``distance`` (N,) how many metres were driven at each. What the
    drive ends in has no next success: it counts up to the last frame, and so as less than it would have become.

    Raises:
        ValueError: the two differ in length, or the distance decreases.
    """
    good, metres = np.asarray(success, dtype=np.bool_), np.asarray(distance, dtype=np.float64)
    if good.ndim != 1 or good.shape != metres.shape:
        raise ValueError(f"one distance a frame is needed, not {metres.shape} for {good.shape}")
    if (np.diff(metres) < 0.0).any():
        raise ValueError("the metres driven cannot decrease")
    change = np.diff(np.concatenate([[True], good, [True]]).astype(np.int8))
    first, after = np.flatnonzero(change < 0), np.flatnonzero(change > 0)
    return np.asarray(metres[np.minimum(after, len(metres) - 1)] - metres[first])


@dataclass(frozen=True, slots=True)
class Coverage:
    """What one system localized of one drive, or of several.

    Attributes:
        frames: how many there were.
        localized: how many of them were localized.
        metres: driven in all.
        dropouts: (D,) metres on dead reckoning of each stretch of failures.
    """

    frames: int
    localized: int
    metres: float
    dropouts: Array

    @property
    def fraction(self) -> float:
        """Coverage: the part of the frames that were localized; 0 without frames."""
        return self.localized / self.frames if self.frames else 0.0

    def beyond(self, metres: float) -> float:
        """``P(dropout > metres)``: how likely a loss of localization is to last longer; 0 where none was lost."""
        return float(survival(self.dropouts, [metres])[0])

    def per_kilometre(self, metres: float = 0.0) -> float:
        """Dropouts longer than ``metres`` in a kilometre of driving; 0 for a drive that goes nowhere.

        Unlike :meth:`beyond` it cannot grow when the shortest dropouts are cured.
        """
        longer = int((self.dropouts > metres).sum())
        return 1e3 * longer / self.metres if self.metres > 0.0 else 0.0


def measure(success: ArrayLike, distance: ArrayLike) -> Coverage:
    """The coverage of one drive, of what :func:`dropouts` takes and with what it raises."""
    lost = dropouts(success, distance)
    good, metres = np.asarray(success, dtype=np.bool_), np.asarray(distance, dtype=np.float64)
    return Coverage(len(good), int(good.sum()), float(metres[-1] - metres[0]) if len(metres) else 0.0, lost)


def pooled(drives: Sequence[Coverage]) -> Coverage:
    """Several drives as one, of all their frames and dropouts."""
    return Coverage(
        frames=sum(drive.frames for drive in drives),
        localized=sum(drive.localized for drive in drives),
        metres=sum(drive.metres for drive in drives),
        dropouts=np.concatenate([np.zeros(0), *(drive.dropouts for drive in drives)]),
    )


def survival(lost: ArrayLike, metres: ArrayLike) -> Array:
    """``P(dropout > x)`` (X,) at distances (X,) of dropouts (D,), all metres; 0 where there was none (Figure 9)."""
    ordered, at = np.sort(np.asarray(lost, dtype=np.float64)), np.asarray(metres, dtype=np.float64)
    if not len(ordered):
        return np.zeros(at.shape)
    return np.asarray(1.0 - np.searchsorted(ordered, at, side="right") / len(ordered))


def failure_reduction(baseline: float, combined: float) -> float | None:
    """The part of the baseline's failures that the combined system cures, of two coverages 0 to 1.

    None where the baseline has no failures; negative where there are more than before.
    """
    failures = 1.0 - baseline
    return (combined - baseline) / failures if failures > 0.0 else None
