"""Structured logs: a line an event, with time, level, robot and process in every one."""

from __future__ import annotations

import logging
import sys

import structlog


def configure(robot: str, process: str, level: str = "info", *, json: bool = False) -> None:
    """Sends logs to standard error, as ``key=value`` or as JSON, bound to a robot and a process."""
    renderer: structlog.typing.Processor = (
        structlog.processors.JSONRenderer()
        if json
        else structlog.processors.LogfmtRenderer(key_order=["timestamp", "level", "robot", "process", "event"])
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            _with_origin(robot, process),
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelNamesMapping()[level.upper()]),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=False,
    )


def _with_origin(robot: str, process: str) -> structlog.typing.Processor:
    """Adds robot and process to an event of any thread, which context variables would not reach."""

    def add(
        _logger: structlog.typing.WrappedLogger, _method: str, event: structlog.typing.EventDict
    ) -> structlog.typing.EventDict:
        return {**event, "robot": robot, "process": process}

    return add
