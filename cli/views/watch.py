"""The terminal view of ``vtr state --watch``: everything that an operator without a browser looks at, in 80 columns."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from cli.processes import Process
from cli.views.state import StateView
from common import topics
from common.bus import Bus
from common.messages import Health, StateName

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDEST = 100
_SLOW_SCALE = 0.999
_GOOD, _CARE, _BAD, _QUIET = "green", "yellow", "bold red", "dim"


@dataclass(frozen=True, slots=True)
class Seen:
    """A process as the bus shows it.

    Attributes:
        name: of the process.
        present: whether it is connected; None while no router answers, for then nobody knows.
        needed: whether the robot stops without it in its present state.
        silent_s: seconds since its last health report, infinite before the first.
        health: that report.
    """

    name: str
    present: bool | None
    needed: bool
    silent_s: float
    health: Health | None


class ProcessWatch:
    """Who of a table of processes is there, and what each last said of its health."""

    def __init__(self, bus: Bus, table: Sequence[Process]) -> None:
        self._bus = bus
        self._table = table
        self._presence = bus.presence()
        self._reports = bus.subscribe(topics.HEALTH)
        self._heard: dict[str, tuple[Health, float]] = {}

    def seen(self, state: str) -> list[Seen]:
        """Every process, in the table's order."""
        while (received := self._reports.poll()) is not None:
            self._heard[received.message.process] = (received.message, received.arrival)
        now, connected = time.monotonic(), self._bus.connected()
        return [self._one(process, state, now, connected=connected) for process in self._table]

    def _one(self, process: Process, state: str, now: float, *, connected: bool) -> Seen:
        health, arrival = self._heard.get(process.name, (None, float("-inf")))
        present = process.name in self._presence if connected else None
        return Seen(process.name, present, state in {str(name) for name in process.critical}, now - arrival, health)


def picture(view: dict[str, Any], processes: Sequence[Seen], robot: str, *, connected: bool) -> RenderableType:
    """What ``--watch`` shows of a view (:meth:`cli.views.state.StateView.json`) and of the processes."""
    state = view["state"]
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style=_QUIET, no_wrap=True)
    grid.add_column(overflow="fold")
    for word, shown in _rows(view, connected=connected):
        grid.add_row(word, shown)
    title = Text.assemble(("robot ", _QUIET), (robot, "bold"), (f" in {state['environment']}", _QUIET))
    return Panel(
        Group(grid, Text(), _processes(processes)),
        title=title,
        title_align="left",
        subtitle=Text("Ctrl-C ends this view, and nothing else", _QUIET),
        subtitle_align="right",
    )


def widest(columns: int) -> int:
    """The width of the view on a terminal of so many columns."""
    return min(columns, _WIDEST)


def _rows(view: dict[str, Any], *, connected: bool) -> list[tuple[str, RenderableType]]:
    state = view["state"]
    rows: list[tuple[str, RenderableType]] = [("state", _state(state, connected=connected))]
    rows.append(("why", Text(state["reason"] or "-")))
    rows.append(("waits for", Text(state["waiting_for"] or "-", _CARE if state["waiting_for"] else "")))
    rows.append(("goals", Text(_goals(state))))
    if state["map"]:
        rows.append(("map", Text(state["map"])))
    if state["position"]:
        rows.append(("position", Text(state["position"])))
    if state["closure"] is not None:
        found = state["closure"]
        text = f"{found['from']} meets {found['to']}: vtr merge --confirm, or --reject"
        rows.append(("closure", Text(text, _CARE)))
    rows += [("safety", _safety(view["safety"])), ("localization", _localization(view["localization"]))]
    rows.append(("path", _path(view["tracker"])))
    return rows


def _state(state: dict[str, Any], *, connected: bool) -> Text:
    text = Text(state["name"], "bold")
    if state["resumes"]:
        text.append(f" (then {state['resumes']})")
    if not connected:
        return text.append("   no router: the last that was heard", _BAD)
    if state["age_s"] > topics.STATE.max_age_s:
        return text.append(f"   the navigator has been silent for {state['age_s']:.1f} s", _BAD)
    seconds = time.time() - state["since"] / 1e9
    return text.append(f"   for {_duration(seconds)}", _QUIET) if seconds >= 0 else text


def _goals(state: dict[str, Any]) -> str:
    names = [name for name in (state["goal"], *(goal["to"] for goal in state["goals"])) if name]
    ahead = f", pauses at {state['pauses_at']}" if state["pauses_at"] else ""
    return (", then ".join(names) or "-") + ahead


def _safety(safety: dict[str, Any] | None) -> Text:
    if safety is None:
        return Text("silent: the robot base stops by itself", _BAD)
    text = Text()
    if safety["latched"]:
        text.append("EMERGENCY STOP latched: vtr estop --reset lifts it", _BAD)
    elif safety["passing"] and safety["scale"] > _SLOW_SCALE:
        text.append("commands pass", _GOOD)
    elif safety["passing"]:
        text.append(f"commands pass, slowed to {100 * safety['scale']:.0f} %", _CARE)
    else:
        text.append("holds the robot", _CARE)
    for reason in safety["reasons"]:
        text.append(f"\n- {reason['text']}")
    return text


def _localization(place: dict[str, Any] | None) -> Text:
    if place is None:
        return Text("-", _QUIET)
    if place["success"]:
        text = Text(f"by {place['stream']}, {place['inliers']} inliers", _GOOD)
    else:
        text = Text("dead reckoning", _CARE)
        since = f" for {place['metres_since_success']:.1f} m and {place['seconds_since_success']:.1f} s"
        text.append(since + (f": {place['reason']}" if place["reason"] else ""))
    return text.append(f"\nat vertex {place['trunk_index']} of the route, {place['trunk']}")


def _path(tracker: dict[str, Any] | None) -> RenderableType:
    if tracker is None:
        return Text("-", _QUIET)
    beside, turned = 100 * tracker["lateral_error"], tracker["heading_error"]
    text = Text(f"{beside:+.1f} cm beside, {turned:+.3f} rad turned, {tracker['remaining']:.1f} m to go")
    whole = tracker["arclength"] + tracker["remaining"]
    if whole <= 0:
        return text
    return Group(
        text, ProgressBar(total=whole, completed=min(tracker["arclength"], whole), width=40, complete_style=_GOOD)
    )


def _processes(processes: Sequence[Seen]) -> Table:
    table = Table.grid(padding=(0, 2))
    for heading in ("process", "", "CPU", "memory", "dropped", "last heard"):
        table.add_column(heading, justify="left" if heading in {"process", ""} else "right", no_wrap=True)
    table.add_row(*(Text(word, _QUIET) for word in ("process", "", "CPU %", "MB", "dropped", "report")))
    for one in processes:
        health, recent = one.health, one.present and one.silent_s <= topics.HEALTH.max_age_s
        figures = ("", "", "")
        if health is not None and recent:
            dropped = sum(health.dropped.values())
            figures = (f"{100 * health.cpu:.0f}", f"{health.memory_mb:.0f}", str(dropped) if dropped else "")
        age = "" if one.silent_s == float("inf") else f"{one.silent_s:.1f} s ago"
        table.add_row(one.name, _presence(one, recent=bool(recent)), *figures, Text(age, _QUIET))
    return table


def _presence(one: Seen, *, recent: bool) -> Text:
    if one.present is None:
        return Text("unknown", _CARE)
    if not one.present:
        return Text("missing, and needed" if one.needed else "missing", _BAD if one.needed else _CARE)
    if one.health is not None and not recent:
        return Text("silent", _CARE)
    return Text("present", _GOOD)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


class Watch:
    """The view that ``--watch`` keeps: the robot's state and its processes on one session."""

    def __init__(self, bus: Bus, view: StateView, table: Sequence[Process], robot: str) -> None:
        self._bus, self._view, self._robot = bus, view, robot
        self._processes = ProcessWatch(bus, table)

    def picture(self) -> RenderableType:
        """As it is now."""
        view = self._view.json()
        seen = self._processes.seen(StateName(view["state"]["name"]))
        return picture(view, seen, self._robot, connected=self._bus.connected())
