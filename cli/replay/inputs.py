"""What a recorded run's estimator was given, in the order in which it took it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from common import topics
from common.messages import Odometry, WheelOdometry
from services.sensors.recordings.mcap import McapTimeline
from services.sensors.recordings.timeline import Entry

_LONG_AGO_NS = 10_000_000_000
"""Older than any report that the estimator would take."""

OnFrame = Callable[[], None]


def inputs(recording: McapTimeline, frames: str, on_frame: OnFrame) -> Iterator[Entry]:
    """The frames under the key ``frames`` that the estimator used, and states, routes and wheels between them.

    A recorder hears the wheels a moment before or after the estimator does. Its odometry tells which report each frame
    was taken with, and that one comes before the frame; where no odometry tells, reports come as recorded.
    """
    said = {o.stamp: o for o in _messages(recording, topics.ODOMETRY.key) if isinstance(o, Odometry)}
    tells = any(odometry.wheels is not None for odometry in said.values())
    reports = {
        report.stamp: report
        for report in (_messages(recording, topics.WHEEL_ODOMETRY.key) if tells else ())
        if isinstance(report, WheelOdometry)
    }
    keys = [frames, topics.STATE.key, topics.ROUTE.key, *([] if tells else [topics.WHEEL_ODOMETRY.key])]
    for found in recording.recorded(keys):
        entry = found.entry
        if entry.key == frames:
            odometry = said.get(getattr(entry.message, "stamp", 0))
            if said and odometry is None:
                continue
            if odometry is not None and reports:
                yield _report(odometry, reports, entry.time_ns)
            on_frame()
        yield entry


def _messages(recording: McapTimeline, key: str) -> Iterator[object]:
    return (found.entry.message for found in recording.recorded([key]))


def _report(odometry: Odometry, reports: dict[int, WheelOdometry], time_ns: int) -> Entry:
    """The wheels' report that a frame was taken with, as of the frame's time; where there was none, one of long ago."""
    report = None if odometry.wheels is None else reports.get(odometry.wheels)
    if report is not None:
        return Entry(time_ns, topics.WHEEL_ODOMETRY, "", report)
    return Entry(time_ns - _LONG_AGO_NS, topics.WHEEL_ODOMETRY, "", next(iter(reports.values())))
