"""Times of day in the synthetic world."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from cli.errors import CommandError
from services.sensors.world import WorldSettings, sun_angles

_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)")


@dataclass(frozen=True, slots=True)
class Times:
    """When a demo teaches its route and when it repeats it, UTC."""

    teach: datetime
    repeat: datetime


def times(teach: str | None, repeat: str | None, world: WorldSettings, *, by_night: bool = False) -> Times:
    """The moments of two clock times (HH:MM, UTC) on the world's day.

    Without a time to teach at, it is the world's own; without one to repeat at, the light stays as it was.

    Raises:
        CommandError: a text is no time, or the sun is down in the world then and not ``by_night``.
    """
    taught = world.time.astimezone(UTC) if teach is None else moment(teach, "--teach-time", world, by_night=by_night)
    repeated = taught if repeat is None else moment(repeat, "--repeat-time", world, by_night=by_night)
    return Times(taught, repeated)


def moment(text: str, option: str, world: WorldSettings, *, by_night: bool = False) -> datetime:
    """The moment of a clock time (HH:MM, UTC) on the world's day; a sensor with a light of its own works ``by_night``.

    Raises:
        CommandError: the text is no time, or the sun is down then and not ``by_night``.
    """
    clock = _CLOCK.fullmatch(text.strip())
    if clock is None:
        raise CommandError(f"{option}: '{text}' is no time of day: write HH:MM, as 09:00")
    at = world.time.astimezone(UTC).replace(hour=int(clock[1]), minute=int(clock[2]), second=0, microsecond=0)
    if not by_night and not _is_day(at, world):
        rise, fall = daylight_hours(at, world)
        advice = f"choose a time from {rise} to {fall}" if rise else "it never rises on the world's day"
        raise CommandError(
            f"{option}: at {at:%H:%M} UTC the sun is down in the world, and a camera sees nothing: {advice}"
        )
    return at


def daylight_hours(day: datetime, world: WorldSettings) -> tuple[str, str]:
    """The first and the last minute (HH:MM, UTC) of a day at which the sun is up; both empty where it never is."""
    minutes = [day.replace(hour=m // 60, minute=m % 60, second=0, microsecond=0) for m in range(24 * 60)]
    up = np.flatnonzero([_is_day(minute, world) for minute in minutes])
    return (f"{minutes[up[0]]:%H:%M}", f"{minutes[up[-1]]:%H:%M}") if len(up) else ("", "")


def _is_day(time: datetime, world: WorldSettings) -> bool:
    return sun_angles(time, world.latitude, world.longitude)[1] > 0.0
