"""Runs the supervisor: ``python -m cli.supervision.daemon supervisord.conf [--attached]``.

Attached, it ends with the process that started it, however that one ends: a robot whose ``vtr up`` was killed does
not drive on without anybody watching it.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

from supervisor import supervisord

_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Runs until every process has ended."""
    configuration, *options = sys.argv[1:]
    if "--attached" in options:
        parent = int(os.environ["VTR_PARENT"])
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it died before it could be watched
            sys.exit(0)
    supervisord.main(["--configuration", configuration])


if __name__ == "__main__":
    main()
