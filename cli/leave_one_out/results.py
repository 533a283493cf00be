"""What a leave-one-out evaluation has shown: the rows of Table I, and each system over all drives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from services.estimator.coverage import Coverage, failure_reduction, measure, pooled

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BASELINE, COMBINED, EXPERIENCED = "baseline", "combined", "experienced"
"""The plain stream by itself; both streams; both streams with repeats at other times in the map."""
WRONG_M, WRONG_DEG = 0.5, 5.0
"""A localization farther off than either is a wrong one."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one system made of a drive of N frames.

    Attributes:
        success: (N,) which frames it localized.
        position_errors: (N,) metres.
        rotation_errors: (N,) radians.
    """

    success: Mask
    position_errors: Array
    rotation_errors: Array

    def wrong(self) -> int:
        """Frames that it localized more than half a metre or five degrees off."""
        off = (self.position_errors > WRONG_M) | (self.rotation_errors > np.radians(WRONG_DEG))
        return int((off & self.success).sum())


@dataclass(frozen=True, slots=True)
class Localized:
    """One drive of N frames localized against one taught route.

    Attributes:
        live, taught: numbers of the two drives.
        distance: (N,) metres driven at each frame.
        invariant: (N,) which frames the invariant stream of the combined system localized.
        outcomes: of each system by name, each driven by itself from start to end.
    """

    live: int
    taught: int
    distance: Array
    invariant: Mask
    outcomes: Mapping[str, Outcome]

    def success(self, system: str) -> Mask:
        """Which frames (N,) a system localized."""
        return self.outcomes[system].success

    def coverage(self, system: str) -> Coverage:
        """Of one of the systems."""
        return measure(self.success(system), self.distance)


@dataclass(frozen=True, slots=True)
class Results:
    """An evaluation of drives at N times of day.

    Attributes:
        times: (N) of the drives.
        elevations: (N) of the sun then, degrees.
        localized: N (N - 1) of them, each drive on each other.
    """

    times: tuple[datetime, ...]
    elevations: tuple[float, ...]
    localized: tuple[Localized, ...]

    @property
    def systems(self) -> tuple[str, ...]:
        """Names of the systems that were tried."""
        return tuple(self.localized[0].outcomes)

    def name(self, drive: int) -> str:
        """A drive's time of day."""
        return f"{self.times[drive]:%H:%M}"

    def of_live(self, drive: int) -> list[Localized]:
        """What one drive was localized against, in order of the taught drives."""
        return sorted((one for one in self.localized if one.live == drive), key=lambda one: one.taught)

    def coverage(self, drive: int, system: str) -> float:
        """A row of Table I: a drive's coverage, averaged over the routes that it was localized against."""
        return float(np.mean([one.coverage(system).fraction for one in self.of_live(drive)]))

    def average(self, system: str) -> float:
        """The last row of Table I."""
        return float(np.mean([self.coverage(drive, system) for drive in range(len(self.times))]))

    def failure_reduction(self) -> float | None:
        """The part of the baseline's average failures that the combined system cures; None where there are none."""
        return failure_reduction(self.average(BASELINE), self.average(COMBINED))

    def overall(self, system: str) -> Coverage:
        """All drives as one."""
        return pooled([one.coverage(system) for one in self.localized])

    def wrong(self, system: str) -> int:
        """Frames that a system localized wrongly."""
        return sum(one.outcomes[system].wrong() for one in self.localized)

    def position_errors(self, system: str) -> Array:
        """Of all frames that a system localized, metres."""
        outcomes = [one.outcomes[system] for one in self.localized]
        return np.concatenate([np.zeros(0), *(outcome.position_errors[outcome.success] for outcome in outcomes)])

    def hardest_live(self) -> int:
        """The drive that the baseline covers least, for Figure 8."""
        return int(np.argmin([self.coverage(drive, BASELINE) for drive in range(len(self.times))]))

    def most_helped(self) -> Localized:
        """The pair of drives in which the invariant stream adds most, for Figure 7."""
        return max(self.localized, key=lambda one: int(one.success(COMBINED).sum()) - int(one.success(BASELINE).sum()))
