"""What was found and what was not, in a sentence."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.fleet import confusion
from services.fleet.confusion import Rival
from services.fleet.many import Found
from services.fleet.series import Series

Array = NDArray[np.float64]


_DAILY = 9.0
"""Log-likelihood of a daily rhythm's four numbers at which it is there, beyond doubt."""


def reason(
    what: str,
    series: Series,
    periods: Array,
    found: Found,
    rivals: Sequence[Rival | None],
    highest: float,
    wanted_shortest: float,
) -> str:
    """The sentence for ``periods`` (K,), hours, of a series of so many samples (``what``).

    ``rivals`` belong to the rhythms that were found before some were given up; ``highest`` is the highest frequency
    that the times can show, 1/hour, beside the shortest period that was wanted, hours.
    """
    parts = [f"{listed(periods)} found in {what} over {days(series.span)}"] if len(periods) else []
    if (
        series.nuisance
        and confusion.evidence_of(dataclasses.replace(series, nuisance=()), np.array(series.nuisance)) > _DAILY
    ):
        parts.append(
            "not enough data to tell 24 h from 12 h: there is such a rhythm, but all times lie in one part of the day"
        )
    for frequency, rival in zip(found.frequencies, rivals, strict=True):
        if rival is not None:
            one, other = hours(1.0 / float(frequency)), hours(1.0 / rival.frequency)
            why = "they are the same at the times of these samples" if rival.same else "both fit about as well"
            parts.append(f"not enough data to tell {one} from {other}: {why}")
    if not parts:
        parts.append(
            f"not enough data for any period, or no rhythm: the strongest in {what} over {days(series.span)}, "
            f"{hours(1.0 / found.next_frequency)}, would come about by chance with probability "
            f"{found.next_probability:.2f}"
        )
    if 1.0 / highest > 1.05 * wanted_shortest:
        parts.append(f"periods below {hours(1.0 / highest)} cannot be told at these times")
    return "; ".join(parts)


def listed(periods: Array) -> str:
    """Periods in words."""
    return ", ".join(hours(float(period)) for period in periods)


def hours(period: float) -> str:
    """A period as one reads it: to four digits."""
    return f"{period:.4g} h"


def days(span: float) -> str:
    """A span as one reads it."""
    return f"{span:.1f} h" if span < 72.0 else f"{span / 24.0:.1f} days"
