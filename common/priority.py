"""A process that must be on time asks the system to let it run before others, with what rights it has."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Callable
from pathlib import Path

import structlog

_REAL_TIME = 10
"""Of 1 to 99: ahead of every ordinary program, behind the kernel's own threads."""
_NICE = -10

log = structlog.get_logger()


def be_on_time() -> None:
    """Puts all threads of this process, and those that they will start, ahead of other processes.

    Real-time scheduling where the system allows it (root, CAP_SYS_NICE or a limit ``rtprio``), else a better nice
    value, else nothing but a line in the log. What was imported is no longer searched for garbage.
    """
    gc.collect()
    gc.freeze()
    if sys.platform != "linux":
        log.warning("busy processes may delay this one: real-time scheduling is for Linux alone")
    elif _for_all_threads(lambda thread: os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(_REAL_TIME))):
        log.info("this process runs in real time", priority=_REAL_TIME)
    elif _for_all_threads(lambda thread: os.setpriority(os.PRIO_PROCESS, thread, _NICE)):
        log.warning("busy processes may delay this one a little: it may not run in real time", nice=_NICE)
    else:
        log.warning("busy processes may delay this one: allow it real time, as with LimitRTPRIO=10 of systemd")


def _for_all_threads(change: Callable[[int], None]) -> bool:
    """Whether a change of its scheduling is allowed for every thread of this process."""
    try:
        for thread in Path("/proc/self/task").iterdir():
            with contextlib.suppress(ProcessLookupError):
                change(int(thread.name))
    except OSError:
        return False
    return True
