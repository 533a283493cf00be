"""Which commands the robot would take now, and why not the others: so that a button says so instead of failing.

The navigator has the last word. This is its table of states as an operator sees it; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from common.messages import State, StateName

_S = StateName
_TEACH = ("sensors", "estimator", "mapstore", "safety")
_REPEAT = ("sensors", "estimator", "tracker", "safety", "mapstore", "planner")
_FOLLOW = ("sensors", "estimator", "tracker", "safety")

_NEEDS: Mapping[StateName, tuple[str, ...]] = {
    _S.TEACH_METRIC_LOCALIZE: _TEACH,
    _S.TEACH_BRANCH: _TEACH,
    _S.TEACH_MERGE: _TEACH,
    _S.REPEAT_PLAN: _REPEAT,
    _S.REPEAT_METRIC_LOCALIZE: (*_FOLLOW, "mapstore"),
    _S.REPEAT_FOLLOW: _FOLLOW,
}
_TEACHING = frozenset({_S.TEACH_METRIC_LOCALIZE, _S.TEACH_BRANCH, _S.TEACH_MERGE})
_MAPPING = frozenset({_S.TEACH_BRANCH, _S.TEACH_MERGE})
_REPEATING = frozenset({_S.REPEAT_PLAN, _S.REPEAT_METRIC_LOCALIZE, _S.REPEAT_FOLLOW})


@dataclass(frozen=True, slots=True)
class Situation:
    """What decides on a command.

    Attributes:
        state: the navigator's, None where it does not tell it.
        present: the processes that are there.
        latched: whether the emergency stop is.
        taught: whether the environment has a taught map.
        bearing: whether the robot drives by bearing alone.
    """

    state: State | None
    present: Collection[str]
    latched: bool
    taught: bool
    bearing: bool = False

    def lacks(self, processes: Collection[str]) -> str:
        """What is missing, in a sentence; empty if nothing."""
        stands_in = {"sensors": "player"}
        gone = [p for p in processes if p not in self.present and stands_in.get(p) not in self.present]
        return f"not running: {', '.join(gone)}" if gone else ""

    @property
    def kept(self) -> StateName | None:
        """What a pause holds; the state itself where there is no pause."""
        if self.state is None:
            return None
        return self.state.resumes if self.state.name is _S.PAUSED else self.state.name

    @property
    def doing(self) -> str:
        """The state within a sentence."""
        state = self.state
        if state is None:
            return ""
        return f"paused in {state.resumes}" if state.name is _S.PAUSED else f"in {state.name}"


Rule = Callable[[State, Situation], str]


def refusals(situation: Situation) -> dict[str, str]:
    """Why each command would be refused, in a sentence; empty for what the robot takes."""
    state = situation.state
    if "navigator" not in situation.present or state is None:
        why = "the navigator is not running" if "navigator" not in situation.present else "its state is unknown yet"
        refused = dict.fromkeys(_RULES, why)
    else:
        refused = {name: rule(state, situation) for name, rule in _RULES.items()}
    store = situation.lacks(["mapstore"])
    refused["name_place"] = store
    refused["restrict"] = refused["restrict"] or store
    refused["stop"] = situation.lacks(["safety"])
    refused["reset"] = refused["stop"] or ("" if situation.latched else "the emergency stop is not latched")
    return refused


def _start(state: State, situation: Situation, first: StateName) -> str:
    if state.name is not _S.IDLE:
        return f"the robot is {situation.doing}: finish or cancel that first"
    return _able(situation, first)


def _able(situation: Situation, first: StateName | None) -> str:
    if gone := situation.lacks(_NEEDS.get(first, ()) if first is not None else ()):
        return gone
    return "the emergency stop is latched: release it first" if situation.latched else ""


def _teach(state: State, situation: Situation) -> str:
    return _start(state, situation, _S.TEACH_METRIC_LOCALIZE)


def _finish(_state: State, situation: Situation) -> str:
    return "" if situation.kept in _MAPPING else "no map is being taught"


def _merge(state: State, situation: Situation) -> str:
    if situation.bearing:
        return "maps by bearing hold no poses that could be joined"
    return "" if state.name in _MAPPING else "a map is merged while it is taught"


def _closure(state: State, _situation: Situation) -> str:
    offered = state.name is _S.TEACH_MERGE and state.closure is not None
    return "" if offered else "no loop closure is offered"


def _branch(state: State, _situation: Situation) -> str:
    return "" if state.name is _S.TEACH_MERGE else "no merge is under way"


def _repeat(state: State, situation: Situation) -> str:
    refused = _start(state, situation, _S.REPEAT_PLAN)
    return refused or ("" if situation.taught else "there is no map to repeat: teach one first")


def _append(_state: State, situation: Situation) -> str:
    return "" if situation.kept in _REPEATING else "the robot is not repeating"


def _swap(state: State, situation: Situation) -> str:
    return _append(state, situation) or _able(situation, _S.REPEAT_PLAN)


def _queue(state: State, _situation: Situation) -> str:
    return "" if state.goals else "no goal is waiting"


def _pause(state: State, situation: Situation) -> str:
    if state.name is _S.PAUSED:
        by_itself = state.waiting_for and "operator" not in state.waiting_for
        return "" if by_itself else "the robot is paused already"
    return "" if situation.kept in _TEACHING | _REPEATING else "there is nothing to pause"


def _pause_ahead(state: State, _situation: Situation) -> str:
    return "" if state.name is _S.REPEAT_FOLLOW else "the robot follows no route"


def _resume(state: State, situation: Situation) -> str:
    if state.name is not _S.PAUSED:
        return "the robot is not paused"
    return _able(situation, state.resumes)


def _cancel(state: State, _situation: Situation) -> str:
    return "the robot is idle" if state.name is _S.IDLE else ""


def _position(state: State, situation: Situation) -> str:
    if state.name is _S.IDLE or situation.kept in _REPEATING:
        return ""
    return "the position can be set when the robot is idle or repeats"


def _find(state: State, situation: Situation) -> str:
    return _position(state, situation) or situation.lacks(["sensors", "estimator"])


def _teleop(state: State, situation: Situation) -> str:
    if situation.latched:
        return "the emergency stop is latched: release it first"
    if state.name not in _TEACHING:
        return "it drives by hand while a map is taught"
    return situation.lacks(["safety", "sensors"])


def _always(_state: State, _situation: Situation) -> str:
    return ""


_RULES: Mapping[str, Rule] = {
    "teach": _teach,
    "finish": _finish,
    "merge": _merge,
    "confirm": _closure,
    "reject": _closure,
    "branch": _branch,
    "repeat": _repeat,
    "append": _append,
    "swap": _swap,
    "drop": _queue,
    "move": _queue,
    "pause": _pause,
    "pause_ahead": _pause_ahead,
    "resume": _resume,
    "cancel": _cancel,
    "position": _position,
    "find": _find,
    "restrict": _always,
    "teleop": _teleop,
}
