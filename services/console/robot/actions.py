"""What an operator asks of the robot by the page, as the bus's own commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from common import topics
from common.bus import Bus
from common.ids import VertexId
from common.messages import Command, Done, Message, NamePlace
from services.console.errors import BadArguments, UnknownAction

M = TypeVar("M", bound=Message)

_DEADLINE_S = 5.0
_LONG_DEADLINE_S = 20.0
"""For what is answered only when something is stored, planned or found."""

_QUICK = frozenset({"pause", "drop", "move", "append", "reject", "branch"})
_TAKES: Mapping[str, frozenset[str]] = {
    "teach": frozenset({"start_place", "vertex"}),
    "finish": frozenset({"start_place", "end_place"}),
    "merge": frozenset({"candidates"}),
    "confirm": frozenset({"end_place"}),
    "reject": frozenset(),
    "branch": frozenset(),
    "repeat": frozenset({"goal", "vertex", "start_place"}),
    "append": frozenset({"goal"}),
    "swap": frozenset({"goal"}),
    "drop": frozenset({"number"}),
    "move": frozenset({"number", "to"}),
    "pause": frozenset({"at_vertex"}),
    "resume": frozenset(),
    "cancel": frozenset(),
    "position": frozenset({"vertex", "find"}),
    "restrict": frozenset({"restriction"}),
}
"""The navigator's commands, and what a page may say of each."""

_WORDS = {
    "start_place": "a place is named with a-z, 0-9, '-' and '_'",
    "end_place": "a place is named with a-z, 0-9, '-' and '_'",
    "place": "a place is named with a-z, 0-9, '-' and '_'",
    "vertex": "a vertex is written as map:index",
}


class Actions:
    """Sends commands in an environment, which ``environment`` tells at the time."""

    def __init__(self, bus: Bus, environment: Callable[[], str]) -> None:
        self._bus = bus
        self._environment = environment

    def do(self, action: str, arguments: Mapping[str, Any]) -> str:
        """Carries a command out and returns the answer's sentence.

        Raises:
            UnknownAction: there is no such command.
            BadArguments: it does not take these.
            RetraverseError: it is refused, or nobody answers.
        """
        given = {key: value for key, value in arguments.items() if value not in (None, "", [])}
        if action == "name_place":
            place = _made(NamePlace, {"environment": self._environment(), **_with_vertices(given)})
            self._bus.ask(topics.NAME_PLACE, place, timeout=_DEADLINE_S)
            return f"{place.vertex} is called {place.place}"
        if action not in _TAKES:
            raise UnknownAction(f"the robot's page knows no '{action}'")
        if unknown := given.keys() - _TAKES[action]:
            raise BadArguments(f"'{action}' takes no '{min(unknown)}'")
        if action in ("teach", "repeat", "position"):
            given["environment"] = self._environment()
        command = _made(Command, {"action": action, **_with_vertices(given)})
        timeout = _DEADLINE_S if action in _QUICK else _LONG_DEADLINE_S
        answer: Done = self._bus.ask(topics.MISSION, command, timeout=timeout)
        return answer.text


def vertex_of(text: object) -> VertexId:
    """The vertex that a page writes as ``map:index``.

    Raises:
        BadArguments: it is none.
    """
    try:
        return VertexId.parse(str(text))
    except ValueError as error:
        raise BadArguments(str(error)) from None


def _with_vertices(given: Mapping[str, Any]) -> dict[str, Any]:
    made = dict(given)
    if "vertex" in made:
        made["vertex"] = vertex_of(made["vertex"])
    if isinstance(made.get("candidates"), list):
        made["candidates"] = [vertex_of(text) for text in made["candidates"]]
    return made


def _made(kind: type[M], fields: Mapping[str, Any]) -> M:
    try:
        return kind.model_validate(dict(fields))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = str(first["loc"][0]) if first["loc"] else ""
        what = _WORDS.get(name, first["msg"].removeprefix("Value error, "))
        raise BadArguments(f"{what}, not '{first['input']}'" if name in _WORDS else f"'{name}': {what}") from None
