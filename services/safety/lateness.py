"""How late a message came on its way, where no two clocks agree: against the quickest of the same sender's.

A link that loses packets stalls for seconds and then delivers what was sent before, one after the other: by its arrival
an operator's "held" of ten seconds ago is young, and so is what a late estimator says of a frame of before. The
difference of arrival and stamp tells, but for a constant: what exceeds the least that was seen of a sender lately is
time spent on the way. It only ever adds to an age, so a wrong clock stops a robot at worst; and one that is set changes
nothing, for then stamps go back, or a new least is seen.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass

_WINDOW_S = 30.0
"""The least is that of one or two such windows: a clock that runs 500 ppm slow gains 30 ms in them."""

_SENDERS_KEPT = 16


@dataclass(slots=True)
class _Sender:
    """The last message of a sender, and the least differences of arrival and stamp of two windows, seconds."""

    arrival: float
    stamp: float
    since: float
    before: float
    least: float
    late: float = 0.0


class Lateness:
    """Asked with each message as it is used; one that was asked for before changes nothing."""

    def __init__(self) -> None:
        self._senders: OrderedDict[Hashable, _Sender] = OrderedDict()

    def of(self, sender: Hashable, stamp_ns: int, arrival: float) -> float:
        """Seconds that a message spent on its way beyond the quickest; ``arrival`` is monotonic time (s)."""
        stamp = stamp_ns / 1e9
        way = arrival - stamp
        known = self._senders.get(sender)
        if known is None or stamp < known.stamp:
            # A new sender, or one whose clock was set back: from here on its messages are compared anew.
            known = self._senders[sender] = _Sender(arrival, stamp, arrival, way, way)
            self._senders.move_to_end(sender)
            if len(self._senders) > _SENDERS_KEPT:
                self._senders.popitem(last=False)
        if (arrival, stamp) == (known.arrival, known.stamp):
            return known.late
        if arrival - known.since > _WINDOW_S:
            known.since, known.before, known.least = arrival, known.least, way
        known.least = min(known.least, way)
        known.arrival, known.stamp = arrival, stamp
        known.late = way - min(known.before, known.least)
        return known.late
