"""Joins what two cameras see at one time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

T = TypeVar("T")
Side = Literal["left", "right"]

_WAITING = 8


@dataclass(frozen=True, slots=True)
class Pair(Generic[T]):
    """What was joined, and the left one's stamp, nanoseconds."""

    stamp_ns: int
    left: T
    right: T


class Joiner(Generic[T]):
    """Joins left and right by stamp: those of one stamp, else the nearest within a tolerance.

    Attributes:
        unmatched: how many were given up, whose other side never came.
    """

    def __init__(self, tolerance_ns: int) -> None:
        self._tolerance = tolerance_ns
        self._waiting: dict[Side, deque[tuple[int, T]]] = {"left": deque(), "right": deque()}
        self.unmatched = 0

    def add(self, side: Side, stamp_ns: int, item: T) -> Pair[T] | None:
        """Takes what one side saw; the pair that it completes.

        What is not newer than a pair is given up, for each side sends in order.
        """
        own, other = self._waiting[side], self._waiting["right" if side == "left" else "left"]
        match = min(other, key=lambda waiting: abs(waiting[0] - stamp_ns), default=None)
        if match is None or abs(match[0] - stamp_ns) > self._tolerance:
            own.append((stamp_ns, item))
            if len(own) > _WAITING:
                own.popleft()
                self.unmatched += 1
            return None
        # What is older would be late by now, and what is as old was joined.
        given_up = self._forget(own, stamp_ns) + self._forget(other, match[0]) - 1
        self.unmatched += given_up
        left, right = ((stamp_ns, item), match) if side == "left" else (match, (stamp_ns, item))
        return Pair(left[0], left[1], right[1])

    @staticmethod
    def _forget(waiting: deque[tuple[int, T]], until_ns: int) -> int:
        """Forgets what is not newer than a stamp; how many there were."""
        newer = [item for item in waiting if item[0] > until_ns]
        count = len(waiting) - len(newer)
        waiting.clear()
        waiting.extend(newer)
        return count
