"""Whether a run was well: no commit lost or doubled, every emergency stop obeyed, all in sync soon after the end."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.bad_network.plan import Plan
from bench.bad_network.site import HELD_S

SYNC_S = 60.0
RESTS_WITHIN_S = HELD_S + 1.0
"""From an emergency stop to rest: the switch's silence, the ramp, and a delayed cycle or two of a busy machine."""

_RAMP_S = 0.1
"""Beyond the switch's limit and the network's delay, for which a word from before the button may still hold."""

Line = dict[str, Any]


@dataclass(slots=True)
class Verdict:
    """What was found; ``wrong`` has a sentence for each thing that must not be."""

    wrong: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Stop:
    """An emergency stop: pressed, at rest, answered and released, monotonic seconds."""

    robot: str
    pressed: float
    rests: float
    latched: float | None
    released: float | None
    cut: bool
    moved: bool


def read(path: Path) -> list[Line]:
    """The lines of a log."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def judge(
    plan: Plan, agent: list[Line], operator: list[Line], robots: dict[str, Any], server: dict[str, Any]
) -> Verdict:
    """The verdict on a run.

    ``robots`` has the contents of each robot's store by robot, ``server`` what ``inventory`` printed.
    """
    verdict = Verdict()
    _commits(verdict, agent, robots, server)
    stops = list(emergency_stops(plan, agent, operator))
    _stops(verdict, stops)
    _cut_off(verdict, plan, agent)
    _sync(verdict, plan, agent, operator)
    return verdict


def _commits(verdict: Verdict, agent: list[Line], robots: dict[str, Any], server: dict[str, Any]) -> None:
    answered: dict[str, dict[str, dict[int, int]]] = defaultdict(lambda: defaultdict(dict))
    for line in (line for line in agent if line["kind"] == "commit"):
        if line["index"] in answered[line["robot"]][line["map"]]:
            verdict.wrong.append(f"{line['map']}:{line['index']} was answered twice")
        answered[line["robot"]][line["map"]][line["index"]] = line["crc"]
    for robot, maps in answered.items():
        expected = {name: [crcs[k] for k in sorted(crcs)] for name, crcs in maps.items()}
        if robots[robot] != expected:
            verdict.wrong.append(f"the store of {robot} does not hold what was answered, or more")
    finished = {line["map"] for line in agent if line["kind"] == "finished"}
    expected = {n: [c[k] for k in sorted(c)] for maps in answered.values() for n, c in maps.items() if n in finished}
    if server["contents"] != expected:
        verdict.wrong.append("the fleet's storage does not hold what was committed, or more")
    for what in ("metadata", "archives"):
        if len(server[what]) != len(finished):
            verdict.wrong.append(f"{len(server[what])} {what} in the storage of {len(finished)} maps")
    verdict.figures["maps"] = len(finished)
    verdict.figures["commits"] = sum(len(crcs) for maps in answered.values() for crcs in maps.values())
    verdict.figures["commits_repeated"] = sum(line["kind"] == "unanswered" for line in agent)


def emergency_stops(plan: Plan, agent: list[Line], operator: list[Line]) -> Iterable[Stop]:
    """Each stop of the operator's, with what the robot's base did then."""
    end = max(line["t"] for line in (*agent, *operator))
    for line in (line for line in operator if line["kind"] == "stop"):
        robot, pressed = line["robot"], line["t"]
        later = {k["kind"]: k["t"] for k in operator if k["robot"] == robot and k.get("number") == line["number"]}
        released = later.get("release")
        rests = next(at for at, moving in motion(agent, robot, pressed) if not moving)
        bound = max(rests, pressed + HELD_S + plan.delay_s + _RAMP_S)
        moved = any(moving and at < (released or end) for at, moving in motion(agent, robot, bound))
        cut = plan.cut(robot, pressed - plan.start)
        yield Stop(robot, pressed, rests, later.get("latched"), released, cut, moved)


def motion(agent: list[Line], robot: str, since: float) -> list[tuple[float, bool]]:
    """When a robot's base begins to move or comes to rest; the first is what it did at ``since``."""
    changes = [(line["t"], line["kind"] == "moves") for line in agent if line["robot"] == robot and _is_motion(line)]
    before = [moving for at, moving in changes if at <= since]
    return [(since, before[-1] if before else False), *((at, moving) for at, moving in changes if at > since)]


def _is_motion(line: Line) -> bool:
    return line["kind"] in {"moves", "rests"}


def _stops(verdict: Verdict, stops: list[Stop]) -> None:
    for stop in stops:
        late = stop.rests - stop.pressed
        if late > RESTS_WITHIN_S:
            verdict.wrong.append(f"{stop.robot} came to rest {late:.1f} s after the emergency stop")
        if stop.moved:
            verdict.wrong.append(f"{stop.robot} moved between an emergency stop and its release")
        if stop.latched is None:
            verdict.wrong.append(f"an emergency stop never arrived at {stop.robot}")
    linked = sorted(s.latched - s.pressed for s in stops if not s.cut and s.latched is not None)
    cut = sorted(s.latched - s.pressed for s in stops if s.cut and s.latched is not None)
    verdict.figures |= {"stops": len(stops), "stops_while_cut_off": sum(s.cut for s in stops)}
    verdict.figures |= _spread("answered_linked_s", linked) | _spread("answered_cut_s", cut)
    verdict.figures |= _spread("rest_s", sorted(s.rests - s.pressed for s in stops))


def _spread(name: str, values: list[float]) -> dict[str, float]:
    return {f"{name}_median": values[len(values) // 2], f"{name}_most": values[-1]} if values else {}


def _cut_off(verdict: Verdict, plan: Plan, agent: list[Line]) -> None:
    """A robot whose operator is gone stops by itself, and stays so."""
    for cut in plan.partitions:
        for robot in cut.robots:
            since, until = plan.start + cut.begins + RESTS_WITHIN_S, plan.start + cut.ends
            if any(moving and at < until for at, moving in motion(agent, robot, since)):
                verdict.wrong.append(f"{robot} moved while it was cut off at {cut.begins:.0f} s")


def _sync(verdict: Verdict, plan: Plan, agent: list[Line], operator: list[Line]) -> None:
    end = plan.start + plan.seconds
    shared = {line["robot"]: line["t"] - end for line in agent if line["kind"] == "shared"}
    known = [line["t"] - end for line in operator if line["kind"] == "known"]
    names = {line["map"] for line in operator if line["kind"] == "known"}
    finished = {line["map"] for line in agent if line["kind"] == "finished"}
    if missing := sorted(set(plan.robots) - shared.keys()):
        verdict.wrong.append(f"not in sync: {', '.join(missing)}")
    if names != finished:
        verdict.wrong.append(f"the server lists {len(names & finished)} of {len(finished)} maps")
    if any(line["kind"] == "twice" for line in operator):
        verdict.wrong.append("the server lists a map twice")
    latest = max([*shared.values(), *known], default=0.0)
    if latest > SYNC_S:
        verdict.wrong.append(f"all in sync only {latest:.0f} s after the last partition")
    verdict.figures["in_sync_s"] = latest
    verdict.figures["metres"] = sum(line["metres"] for line in agent if line["kind"] == "driven")
