"""State, route and safety as the page shows them."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.ids import VertexId
from common.messages import Goal, Route, SafetyStatus, State

_NO_LIMIT = 1e3
"""A route's speed limit that is none, m/s."""


def state_section(state: State) -> dict[str, Any]:
    """The navigator's state, without what changes though nothing happens."""
    closure = state.closure
    return {
        "name": state.name.value,
        "environment": state.environment,
        "since": state.since // 1_000_000,
        "reason": state.reason,
        "waiting": state.waiting_for,
        "resumes": None if state.resumes is None else state.resumes.value,
        "map": None if state.map is None else state.map.id,
        "route": state.route,
        "target": _text(state.target),
        "position": _text(state.position),
        "goal": state.goal,
        "goals": [_goal(goal) for goal in state.goals],
        "pauses_at": _text(state.pauses_at),
        "candidates": len(state.candidates),
        "closure": None
        if closure is None
        else {"from": str(closure.edge.a), "to": str(closure.edge.b), "inliers": closure.inliers},
    }


def route_section(route: Route) -> dict[str, Any]:
    """A route as runs of vertices, ``[map, first, last]`` each, and the limits that hold on it."""
    return {
        "id": route.id,
        "goal": route.goal,
        "length": round(route.length, 1),
        "runs": runs(route.vertices),
        "limits": [round(limit, 2) if limit < _NO_LIMIT else None for limit in route.speed_limits],
        "reason": route.reason,
        "why": list(route.why),
        "plan": list(route.plan),
        "next": route.next_map,
    }


def runs(vertices: list[VertexId]) -> list[list[Any]]:
    """Vertices in order as ``[map, first, last]``, wherever their indices go up or down by one."""
    found: list[list[Any]] = []
    for map_id, index in vertices:
        if found and found[-1][0] == map_id:
            _, first, last = found[-1]
            step = int(np.sign(last - first))
            if abs(index - last) == 1 and step in (0, index - last):
                found[-1][2] = index
                continue
        found.append([map_id, index, index])
    return found


def safety_section(status: SafetyStatus) -> dict[str, Any]:
    """What safety lets through, and every reason against."""
    return {
        "passing": status.passing,
        "scale": round(status.scale, 2),
        "latched": status.latched,
        "reasons": [{"rule": reason.rule, "text": reason.text} for reason in status.reasons],
    }


def _goal(goal: Goal) -> dict[str, Any]:
    return {"to": goal.to, "mode": goal.mode, "before": goal.pause_before, "after": goal.pause_after}


def _text(vertex: VertexId | None) -> str | None:
    return None if vertex is None else str(vertex)
