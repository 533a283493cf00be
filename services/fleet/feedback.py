"""What repeats have told of each map: metres, metres lost, frames and slow ones, by the hour of the day.

Each report is counted once, at the hour (UTC) at which the repeat began. A metre on which frames came too late counts a
part of one that was not localized: of an hour's sums,

``bad = lost + SLOW (slow / frames) (metres - lost)``

and the trouble is that of :mod:`common.environment.trouble`, of ``metres`` and ``bad``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.environment.trouble import HOURS, shares
from common.messages import RepeatReport

Array = NDArray[np.float64]

SLOW = 0.25
"""What a metre with slow frames counts, of one that was lost."""

METRES, LOST, FRAMES, SLOW_FRAMES = range(4)
_NANOSECONDS_AN_HOUR = 3_600_000_000_000


@dataclass(slots=True)
class Feedback:
    """What the reports of an environment tell, each counted once.

    Attributes:
        counted: the keys of the reports that are in the sums.
        sums: map to (4, 24): metres, metres lost, frames and slow frames, by hour of the day.
    """

    counted: set[str] = field(default_factory=set)
    sums: dict[str, Array] = field(default_factory=dict)

    def add(self, key: str, report: RepeatReport) -> list[str]:
        """Counts a report that is stored under ``key``, if it is not counted yet; the maps of which it tells."""
        if key in self.counted:
            return []
        self.counted.add(key)
        hour = report.stamp // _NANOSECONDS_AN_HOUR % HOURS
        for told in report.maps:
            sums = self.sums.setdefault(told.map, np.zeros((4, HOURS)))
            sums[:, hour] += (told.metres, min(told.lost, told.metres), told.frames, min(told.slow, told.frames))
        return [told.map for told in report.maps]

    def trouble(self, map_id: str) -> tuple[float, ...]:
        """The trouble of a map by hour of the day; empty where nobody has told of any."""
        sums = self.sums.get(map_id)
        if sums is None or not (sums[LOST].any() or sums[SLOW_FRAMES].any()):
            return ()
        return tuple(np.round(trouble(sums), 4).tolist())

    def to_json(self) -> dict[str, object]:
        """Plain values, for storing."""
        return {"counted": sorted(self.counted), "sums": {name: sums.tolist() for name, sums in self.sums.items()}}

    @classmethod
    def from_json(cls, counted: Iterable[str], sums: dict[str, list[list[float]]]) -> Self:
        """What :meth:`to_json` made.

        Raises:
            ValueError: the sums are of another shape, or not finite.
        """
        made = cls(set(counted), {name: np.array(rows, dtype=np.float64) for name, rows in sums.items()})
        for rows in made.sums.values():
            if rows.shape != (4, HOURS) or not np.isfinite(rows).all():
                raise ValueError("the sums of reports are no four rows of a day's hours")
        return made


def trouble(sums: Array) -> Array:
    """(24,) the trouble of a map, in [0, 1], from its sums (4, 24)."""
    metres, lost = sums[METRES], sums[LOST]
    slow = np.divide(sums[SLOW_FRAMES], sums[FRAMES], out=np.zeros(HOURS), where=sums[FRAMES] > 0.0)
    return shares(metres, lost + SLOW * slow * (metres - lost))
