"""Two runs, message by message: where they part first, and how far they do."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from pydantic import BaseModel

from common import geometry, topics
from common.messages import Message
from common.topics import Topic
from services.sensors.recordings.mcap import McapTimeline
from services.sensors.recordings.timeline import SENSORS, Entry

_CLOCK_FIELDS = frozenset({"seconds_since_success"})
"""Told by the clock of the process, not by its inputs."""


@dataclass(slots=True)
class Difference:
    """How far one field of a topic's messages differs: at most, and where that is.

    Attributes:
        unit: "m" and "rad" of the motion between two transforms, "" of plain numbers, "unequal" of all else.
        largest: over all messages; 1 for what is unequal.
        stamp: of the message where it is.
        count: of messages in which the field differs by more than the tolerance.
    """

    unit: str
    largest: float = 0.0
    stamp: int = 0
    count: int = 0


@dataclass(slots=True)
class TopicReport:
    """One topic: messages that both runs have by stamp, and those of one alone, and each field's difference."""

    both: int = 0
    only_first: int = 0
    only_second: int = 0
    fields: dict[str, Difference] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FirstDifference:
    """The first message that differs: what of it, and in words how."""

    topic: str
    stamp: int
    seconds: float
    field: str
    first: str
    second: str


@dataclass(slots=True)
class Report:
    """Two runs compared; ``first`` is None where they agree within the tolerance."""

    tolerance: float
    first: FirstDifference | None = None
    topics: dict[str, TopicReport] = field(default_factory=dict)

    @property
    def agree(self) -> bool:
        """Whether the runs have the same messages, within the tolerance."""
        return self.first is None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"agree": self.agree, **asdict(self)}


def is_compared(topic: Topic) -> bool:
    """Whether a topic is a service's own doing: not a sensor's, and not a figure of how it fared."""
    return topic not in SENSORS and topic not in (topics.HEALTH, topics.TRUTH)


def entries_of(recording: McapTimeline, keys: frozenset[str]) -> list[Entry]:
    """What of a recording is compared: the keys that are named, else what services said."""
    wanted = keys or frozenset(
        key for key in recording.all_counts if (found := topics.find(key)) and is_compared(found[0])
    )
    return [found.entry for found in recording.recorded(wanted)]


def compare(
    first: Iterable[Entry], second: Iterable[Entry], tolerance: float, ignored: frozenset[str] = frozenset()
) -> Report:
    """Compares two runs' messages by topic and stamp.

    Numbers differ where they do by more than ``tolerance`` times one plus their size; transforms where the motion
    between them is longer than that in metres or radians. Fields of the names ``ignored`` are left out.
    """
    report = Report(tolerance)
    runs = _by_key(first), _by_key(second)
    times = [entry.time_ns for run in runs for found in run.values() for entry in found.values()]
    began = min(times, default=0)
    parted: list[tuple[int, FirstDifference]] = []
    for key in sorted(runs[0].keys() | runs[1].keys()):
        a, b = (run.get(key, {}) for run in runs)
        both = sorted(a.keys() & b.keys())
        row = report.topics[key] = TopicReport(len(both), len(a) - len(both), len(b) - len(both))
        for stamp in sorted(a.keys() ^ b.keys())[:1]:
            alone = a.get(stamp) or b[stamp]
            words = ("there", "missing") if stamp in a else ("missing", "there")
            parted.append((alone.time_ns, FirstDifference(key, stamp[0], _since(alone, began), "message", *words)))
        for stamp in both:
            found = _compare_message(a[stamp].message, b[stamp].message, row, stamp[0], (tolerance, ignored))
            if found is not None:
                parted.append((a[stamp].time_ns, FirstDifference(key, stamp[0], _since(a[stamp], began), *found)))
    if parted:
        report.first = min(parted, key=lambda pair: pair[0])[1]
    return report


def _since(entry: Entry, began: int) -> float:
    return (entry.time_ns - began) / 1e9


def _by_key(entries: Iterable[Entry]) -> dict[str, dict[tuple[int, int], Entry]]:
    """Messages by key and stamp; of several with one stamp each has its number."""
    made: dict[str, dict[tuple[int, int], Entry]] = {}
    for index, entry in enumerate(entries):
        stamp, number = int(getattr(entry.message, "stamp", index)), 0
        found = made.setdefault(entry.key, {})
        while (stamp, number) in found:
            number += 1
        found[stamp, number] = entry
    return made


def _compare_message(
    a: Message, b: Message, row: TopicReport, stamp: int, judge: tuple[float, frozenset[str]]
) -> tuple[str, str, str] | None:
    """Notes every field's difference; the name and the two values of the first that is beyond the tolerance."""
    tolerance, ignored = judge
    first: tuple[str, str, str] | None = None
    for name, x, y in _fields("", a, b):
        if name.rpartition(".")[2] in _CLOCK_FIELDS | ignored:
            continue
        for unit, size, allowed in _differences(name, x, y, tolerance):
            noted = row.fields.setdefault(f"{name} [{unit}]" if unit else name, Difference(unit))
            if size > noted.largest:
                noted.largest, noted.stamp = size, stamp
            if size > allowed:
                noted.count += 1
                first = first or (name, _text(x), _text(y))
    return first


def _fields(prefix: str, a: object, b: object) -> Iterator[tuple[str, object, object]]:
    """The leaves of two messages of one model, by their dotted names."""
    if isinstance(a, BaseModel) and isinstance(b, BaseModel):
        for name in type(a).model_fields:
            yield from _fields(f"{prefix}.{name}".lstrip("."), getattr(a, name), getattr(b, name))
    elif isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        for name in a:
            yield from _fields(f"{prefix}.{name}", a[name], b[name])
    else:
        yield prefix, a, b


def _differences(name: str, a: object, b: object, tolerance: float) -> list[tuple[str, float, float]]:
    """Unit, size, and what is allowed, of the difference of two leaves."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        if a.shape != b.shape:
            return [("unequal", 1.0, 0.0)]
        if a.shape == (4, 4) and name.rpartition(".")[2].startswith("T_"):
            between = geometry.inverse(a) @ b
            turned = float(geometry.rotation_angle(between))
            return [("m", float(np.linalg.norm(between[:3, 3])), tolerance), ("rad", turned, tolerance)]
        x, y = a.astype(np.float64), b.astype(np.float64)
        size = float(np.abs(x - y).max(initial=0.0))
        return [("", size, tolerance * (1.0 + float(np.abs(x).max(initial=0.0))))]
    if _is_number(a) and _is_number(b):
        size = abs(float(a) - float(b))  # type: ignore[arg-type]
        return [("", size if math.isfinite(size) else math.inf, tolerance * (1.0 + abs(float(a))))]  # type: ignore[arg-type]
    return [("unequal", 0.0 if a == b else 1.0, 0.0)]


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _text(value: object) -> str:
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=6, max_line_width=10_000, threshold=40).replace("\n", "")
    return str(value)[:200]
