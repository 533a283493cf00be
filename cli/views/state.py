"""What the robot is doing, gathered from the bus for ``vtr state``."""

from __future__ import annotations

import time
from typing import Any

from cli.errors import CommandError
from common import geometry, topics
from common.bus import Bus
from common.messages import Localization, LoopClosure, SafetyStatus, State, TrackerStatus

_DEADLINE_S = 2.0
_POLL_S = 0.05


class StateView:
    """The newest state, safety status, localization and tracker status of a robot."""

    def __init__(self, bus: Bus) -> None:
        self._state = bus.subscribe(topics.STATE)
        self._safety = bus.subscribe(topics.SAFETY_STATUS)
        self._localization = bus.subscribe(topics.LOCALIZATION)
        self._tracker = bus.subscribe(topics.TRACKER_STATUS)

    def wait(self) -> None:
        """Waits for the first state, and as long again for safety's where that has not come.

        Raises:
            CommandError: the navigator does not tell its state.
        """
        end = time.monotonic() + _DEADLINE_S
        while time.monotonic() < end:
            if self._state.last() is not None and self._safety.last() is not None:
                return
            time.sleep(_POLL_S)
        if self._state.last() is None:
            raise CommandError("the navigator does not tell its state: is it running? See vtr ps.")

    def json(self) -> dict[str, Any]:
        """All of it as JSON holds it; what nobody publishes at present is null."""
        state = self._state.last()
        assert state is not None  # noqa: S101, wait() has returned
        return {
            "state": _state(state.message, self._state.age()),
            "safety": _safety(self._safety.fresh()),
            "localization": _localization(self._localization.fresh()),
            "tracker": _tracker(self._tracker.fresh()),
        }


def lines(view: dict[str, Any]) -> list[tuple[str, str]]:
    """The same for a reader: pairs of a word and a sentence."""
    state, safety, place, tracker = view["state"], view["safety"], view["localization"], view["tracker"]
    shown = [("state", state["name"]), ("why", state["reason"]), ("waits for", state["waiting_for"])]
    shown += [("goal", state["goal"]), ("then", ", ".join(goal["to"] for goal in state["goals"]))]
    shown += [("map", state["map"] or ""), ("position", state["position"] or "")]
    shown.append(("pauses at", state["pauses_at"] or ""))
    if safety is None:
        shown.append(("safety", "silent: the robot base stops by itself"))
    else:
        reasons = "; ".join(reason["text"] for reason in safety["reasons"])
        latch = "emergency stop latched; " if safety["latched"] else ""
        shown.append(("safety", latch + ("commands pass" if safety["passing"] else reasons or "holds the robot")))
    if state["closure"] is not None:
        found = state["closure"]
        text = f"{found['from']} meets {found['to']}, {found['x']:+.2f} m ahead and {found['y']:+.2f} m to the left"
        shown.append(("closure", f"{text}: vtr merge --confirm, or --reject"))
    if place is not None:
        quality = "localized" if place["success"] else f"dead reckoning for {place['metres_since_success']:.1f} m"
        shown.append(("localization", f"{quality} at {place['trunk']}, {place['inliers']} inliers"))
    if tracker is not None:
        text = f"{tracker['lateral_error'] * 100:+.1f} cm beside the path, {tracker['remaining']:.1f} m to go"
        shown.append(("tracker", text))
    if state["age_s"] > topics.STATE.max_age_s:
        shown.append(("age", f"the navigator has been silent for {state['age_s']:.1f} s"))
    return [(word, text) for word, text in shown if text]


def _state(state: State, age: float) -> dict[str, Any]:
    return {
        "name": str(state.name),
        "environment": state.environment,
        "since": state.since,
        "reason": state.reason,
        "waiting_for": state.waiting_for,
        "resumes": None if state.resumes is None else str(state.resumes),
        "map": None if state.map is None else state.map.id,
        "route": state.route,
        "goal": state.goal,
        "goals": [goal.model_dump(mode="json") for goal in state.goals],
        "pauses_at": None if state.pauses_at is None else str(state.pauses_at),
        "candidates": [str(vertex) for vertex in state.candidates],
        "closure": _closure(state.closure),
        "target": None if state.target is None else str(state.target),
        "position": None if state.position is None else str(state.position),
        "age_s": round(age, 3),
    }


def _closure(closure: LoopClosure | None) -> dict[str, Any] | None:
    if closure is None:
        return None
    T = closure.edge.T_a_b
    return {
        "from": str(closure.edge.a),
        "to": str(closure.edge.b),
        "inliers": closure.inliers,
        "x": round(float(T[0, 3]), 3),
        "y": round(float(T[1, 3]), 3),
        "yaw": round(float(geometry.yaw_of(T)), 4),
    }


def _safety(status: SafetyStatus | None) -> dict[str, Any] | None:
    return None if status is None else status.model_dump(mode="json", exclude={"stamp"})


def _localization(message: Localization | None) -> dict[str, Any] | None:
    if message is None:
        return None
    T = message.T_trunk_robot
    kept = {"route", "trunk_index", "success", "stream", "streams", "inliers", "reason", "metric"}
    since = {"metres_since_success", "seconds_since_success"}
    return {
        **message.model_dump(mode="json", include=kept | since),
        "trunk": str(message.trunk),
        "trunk_to_robot": {
            "x": round(float(T[0, 3]), 4),
            "y": round(float(T[1, 3]), 4),
            "yaw": round(float(geometry.yaw_of(T)), 5),
        },
    }


def _tracker(status: TrackerStatus | None) -> dict[str, Any] | None:
    return None if status is None else status.model_dump(mode="json", exclude={"stamp"})
