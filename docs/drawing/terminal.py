"""The view of ``vtr state --watch`` as it looks in a terminal of 80 columns, on an example."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console

from cli.processes import ROBOT
from cli.views.watch import Seen, picture
from common.messages import Health, StateName

_MAP = "20261126T101500000000-rover-5f3a1c"
_ABSENT = "planner"
_VIEW: dict[str, Any] = {
    "state": {
        "name": str(StateName.REPEAT_FOLLOW),
        "environment": "garden",
        "since": 2**62,
        "reason": "localized on the route to gate",
        "waiting_for": "",
        "resumes": None,
        "map": None,
        "goal": "gate",
        "goals": [{"to": "shed"}],
        "pauses_at": None,
        "position": f"{_MAP}:0",
        "closure": None,
        "age_s": 0.05,
    },
    "safety": {
        "passing": True,
        "latched": False,
        "scale": 0.93,
        "reasons": [
            {
                "rule": "metres_unlocalized",
                "text": "3.7 m since the last localization; the robot slows down beyond 3.0 m.",
            }
        ],
    },
    "localization": {
        "success": False,
        "stream": "plain",
        "inliers": 11,
        "metres_since_success": 3.7,
        "seconds_since_success": 3.3,
        "reason": "only 11 landmarks agree",
        "trunk": f"{_MAP}:112",
        "trunk_index": 112,
    },
    "tracker": {"lateral_error": 0.012, "heading_error": -0.004, "arclength": 44.8, "remaining": 27.2},
}


def example() -> str:
    """The view, without its colours, as a block of text."""
    out = io.StringIO()
    processes = [_seen(name, present=name != _ABSENT) for name in (process.name for process in ROBOT)]
    console = Console(file=out, width=80, force_terminal=False, color_system=None)
    console.print(picture(_VIEW, processes, "rover", connected=True))
    lines = (line.rstrip() for line in out.getvalue().splitlines())
    return "```text\n" + "\n".join(lines) + "\n```\n"


def _seen(name: str, *, present: bool) -> Seen:
    health = Health(
        stamp=1, process=name, pid=1, started=1, cpu=len(name) / 40, memory_mb=60.0 + 20 * len(name),
        rates={}, dropped={}, stages={},
    )  # fmt: skip
    return Seen(name, present, needed=False, silent_s=0.4 if present else 12.6, health=health)
