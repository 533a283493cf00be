"""What tells a sample or a question that is sent again from the one that it was copied from.

Nothing here looks at a clock. What a receiver has never heard it cannot tell from what is new, so one that was
started anew would take an old sample as long as nothing newer comes: who may send at all is the router's business.
"""

from __future__ import annotations

from collections import OrderedDict

from common.bus.envelope import Source

_QUESTIONS_KEPT = 4096


class Asked:
    """The questions that one answerer has heard last: each of them is answered once.

    It keeps them one by one, and no highest number: whoever could make one up for another asker would keep that one
    from being heard, an emergency stop too.
    """

    def __init__(self) -> None:
        self._heard: OrderedDict[tuple[Source, int], None] = OrderedDict()

    def first_time(self, source: Source, number: int) -> bool:
        """Whether a question was not heard yet; it is now."""
        if (source, number) in self._heard:
            return False
        self._heard[source, number] = None
        if len(self._heard) > _QUESTIONS_KEPT:
            self._heard.popitem(last=False)
        return True
