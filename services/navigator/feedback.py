"""What a repeat has to tell the fleet of the maps that it followed: where it did not localize, and was slow."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common import geometry
from common.geometry import Array
from common.messages import Localization, MapReport, RepeatReport, Route, Span

LOST_M = 1.0
"""Farther than this on dead reckoning, metres do not count as localized."""

_SLOW = 1.5
_MOST_SPANS = 1000


@dataclass(slots=True)
class _OnMap:
    """What happened on one map; the bounds of a stretch that is being lost, if one is."""

    metres: float = 0.0
    lost: float = 0.0
    frames: int = 0
    slow: int = 0
    spans: list[Span] = field(default_factory=list)
    lost_from: float | None = None


class Feedback:
    """Adds up the localizations of one repeat; ``period_s`` is that of frames."""

    def __init__(self, report_id: str, robot: str, environment: str, stamp: int, period_s: float) -> None:
        self._head = {"id": report_id, "robot": robot, "environment": environment, "stamp": stamp}
        self._period_ns = period_s * 1e9
        self._maps: dict[str, _OnMap] = {}
        self._arclength: Array = np.zeros(1)
        self._begins: dict[str, float] = {}
        self._route: Route | None = None
        self._along = 0.0
        self._last_stamp = 0

    def follow(self, route: Route) -> None:
        """Takes the route, or a longer one that begins as the last, or the one that comes after it."""
        before = self._route
        goes_on = before is not None and route.vertices[: len(before.vertices)] == before.vertices
        self._route = route
        self._arclength = geometry.arclength(route.path)
        self._begins = {}
        for vertex, metres in zip(route.vertices, self._arclength.tolist(), strict=True):
            self._begins.setdefault(vertex.map_id, metres)
        if not goes_on:
            self._along = 0.0

    def take(self, message: Localization) -> None:
        """Takes a localization on the route."""
        route = self._route
        if route is None or message.route != route.id or message.trunk_index >= len(self._arclength):
            return
        on = self._maps.setdefault(message.trunk.map_id, _OnMap())
        along = float(self._arclength[message.trunk_index]) + float(message.T_trunk_robot[0, 3])
        step = max(along - self._along, 0.0)
        self._along = max(self._along, along)
        on.metres += step
        on.frames += 1
        on.slow += self._last_stamp > 0 and message.stamp - self._last_stamp > _SLOW * self._period_ns
        self._last_stamp = message.stamp
        self._count_lost(on, message, step)

    def report(self, *, arrived: bool) -> RepeatReport | None:
        """The report, None where no map was followed; the map on which the robot gave up is not finished."""
        if not self._maps:
            return None
        last = next(reversed(self._maps))
        for on in self._maps.values():
            self._close(on, self._along)
        return RepeatReport(
            **self._head,  # type: ignore[arg-type]
            maps=[
                MapReport(
                    map=map_id,
                    metres=round(on.metres, 3),
                    lost=round(min(on.lost, on.metres), 3),
                    spans=on.spans[:_MOST_SPANS],
                    frames=on.frames,
                    slow=on.slow,
                    finished=arrived or map_id != last,
                )
                for map_id, on in self._maps.items()
            ],
        )

    def _count_lost(self, on: _OnMap, message: Localization, step: float) -> None:
        begin = self._begins.get(message.trunk.map_id, 0.0)
        if message.metres_since_success > LOST_M:
            if on.lost_from is None:
                on.lost_from = max(self._along - begin - message.metres_since_success, 0.0)
                step = message.metres_since_success
            on.lost += step
        elif on.lost_from is not None:
            self._close(on, self._along - begin)

    @staticmethod
    def _close(on: _OnMap, metres: float) -> None:
        if on.lost_from is not None:
            on.spans.append(Span(start=round(on.lost_from, 2), end=round(max(metres, on.lost_from), 2)))
            on.lost_from = None
