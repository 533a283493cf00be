"""What a shell may complete on ``<TAB>`` beside commands and options: a running robot's places, maps and environments.

A shell must not be kept waiting, nor be shown an error while somebody types: without an answer nothing is offered.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from common.errors import RetraverseError

if TYPE_CHECKING:
    from common.messages import MapSummary

_CONNECT_S = 0.6
_ANSWER_S = 0.6


def places(context: typer.Context, incomplete: str) -> list[str]:
    """The named places between which the robot's maps lead."""
    ends = {place for one in _maps(context) for place in (one.start_place, one.end_place) if place is not None}
    return sorted(place for place in ends if place.startswith(incomplete))


def maps(context: typer.Context, incomplete: str) -> list[str]:
    """The ids of the stored maps."""
    return [one.record.id for one in _maps(context) if one.record.id.startswith(incomplete)]


def environments(context: typer.Context, incomplete: str) -> list[str]:
    """The environments of the stored maps."""
    found = {one.record.environment for one in _maps(context)}
    return sorted(name for name in found if name.startswith(incomplete))


def modes(incomplete: str) -> list[str]:
    """The named ways to choose maps."""
    from common.environment.costs import MODES

    return [mode for mode in MODES if mode.startswith(incomplete)]


def _maps(context: typer.Context) -> list[MapSummary]:
    from cli import client, robot
    from common import topics
    from common.messages import GraphQuery

    config: Any = context.params.get("config")
    found: list[MapSummary] = []
    with contextlib.suppress(RetraverseError):
        configuration = robot.load(None if config is None else Path(config))
        with client.connect(configuration, timeout=_CONNECT_S) as bus:
            found = bus.ask(topics.MAPS, GraphQuery(), timeout=_ANSWER_S).maps
    return found
