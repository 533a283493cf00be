"""Short names for what has long ones, and periods for a reader."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

_MAP = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)\d{8}-(?P<robot>.+)-(?P<last>[0-9a-f]{6})")


def robot_of(map_id: str) -> str:
    """The robot that recorded a map; empty where its id names none."""
    match = _MAP.fullmatch(map_id)
    return match["robot"] if match else ""


def short_names(map_ids: Iterable[str]) -> list[str]:
    """Map ids as ``06-21 11:00 r1``, with the last digits too where two would be the same."""
    ids = list(map_ids)
    short = [_short(name) for name in ids]
    count = Counter(short)
    return [f"{text} {name[-6:]}" if count[text] > 1 else text for text, name in zip(short, ids, strict=True)]


def place_name(place: str) -> str:
    """A place, or the vertex that stands for one that nobody has named, shortened."""
    map_id, colon, index = place.rpartition(":")
    return f"{_short(map_id)}:{index}" if colon else place


def period_text(hours: float) -> str:
    """A period in hours, days or years, as a reader would say it."""
    for unit, size, least in (("year", 8766.0, 8766.0), ("day", 24.0, 72.0)):
        if hours >= least:
            text = f"{hours / size:.4g}"
            return f"{text} {unit}" if text == "1" else f"{text} {unit}s"
    return f"{hours:.4g} h"


def _short(map_id: str) -> str:
    match = _MAP.fullmatch(map_id)
    if match is None:
        return map_id
    _, month, day, hour, minute = match.groups()[:5]
    return f"{month}-{day} {hour}:{minute} {match['robot']}"
