"""A process in figures."""

from __future__ import annotations

from common.messages.base import Count, Message, Name, NotNegative, Stamp


class Percentiles(Message):
    """Durations of one stage, milliseconds, over its last thousand runs; ``count`` is that of all runs."""

    count: Count
    p50: NotNegative
    p99: NotNegative


class Health(Message):
    """A process in figures, once a second: rates (Hz) by topic, stages' durations, CPU (fraction of a core), memory."""

    stamp: Stamp
    process: Name
    pid: Count
    started: Stamp
    cpu: NotNegative
    memory_mb: NotNegative
    rates: dict[str, NotNegative]
    dropped: dict[str, Count]
    stages: dict[str, Percentiles]
