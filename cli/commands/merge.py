"""``vtr merge``."""

from typing import TYPE_CHECKING, Annotated

import typer

from cli import arguments, completion
from cli.arguments import ConfigOption, JsonOption
from cli.errors import CommandError

if TYPE_CHECKING:
    from common.bus import Bus
    from common.ids import VertexId
    from common.messages import State, Topology

_STATE_S = 2.0
_MOST = 64


def merge(
    candidates: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CANDIDATE...]",
            help="Where the map may meet others: places, or vertices map:index.",
            autocompletion=completion.places,
        ),
    ] = None,
    *,
    around: Annotated[
        int, typer.Option(metavar="N", min=0, help="So many vertices before and after each candidate are tried too.")
    ] = 2,
    confirm: Annotated[
        bool, typer.Option("--confirm", help="Accept the loop closure that is offered; the map ends there.")
    ] = False,
    reject: Annotated[bool, typer.Option("--reject", help="Refuse it; the other candidates are tried on.")] = False,
    leave: Annotated[bool, typer.Option("--leave", help="Go on teaching without a loop closure.")] = False,
    end_place: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the map's last vertex, with --confirm; by default the place met."),
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Join the map being taught to a map that the robot has driven back to; vtr state shows what is found."""
    from cli import client, robot
    from cli.operator import LONG_DEADLINE_S, order, report
    from common.messages import Command

    if bool(candidates) + confirm + reject + leave != 1:
        raise CommandError("give candidates, or one of --confirm, --reject and --leave")
    if end_place is not None and not confirm:
        raise CommandError("--end-place names where a map ends: give it with --confirm")
    place = arguments.name(end_place, "--end-place")
    with client.connect(robot.load(config)) as bus:
        if confirm:
            command = Command(action="confirm", end_place=place)
        elif reject or leave:
            command = Command(action="reject" if reject else "branch")
        else:
            command = Command(action="merge", candidates=_vertices(bus, candidates or [], around))
        report(order(bus, command, LONG_DEADLINE_S), command, as_json=as_json)


def _vertices(bus: "Bus", texts: list[str], around: int) -> "list[VertexId]":
    """The vertices that are meant, with those around them, the named ones first."""
    from cli.map_store import topology

    state = _state(bus)
    graph = topology(bus, state.environment)
    named = [_vertex(graph, text) for text in texts]
    sizes = {summary.record.id: summary.vertices for summary in graph.maps}
    near = [
        vertex._replace(index=index)
        for vertex in named
        for index in range(vertex.index - around, vertex.index + around + 1)
        if 0 <= index < sizes[vertex.map_id]
    ]
    found = list(dict.fromkeys([*named, *near]))
    if len(found) > _MOST:
        raise CommandError(
            f"these are {len(found)} candidates; at most {_MOST} can be tried: name fewer, or less --around"
        )
    return found


def _vertex(graph: "Topology", text: str) -> "VertexId":
    from common.ids import VertexId

    if text in graph.places:
        return graph.places[text]
    try:
        vertex = VertexId.parse(text)
    except ValueError:
        known = ", ".join(sorted(graph.places)) or "none yet"
        raise CommandError(f"'{text}' is neither a vertex, map:index, nor a place; the places are {known}") from None
    if not any(s.record.id == vertex.map_id and vertex.index < s.vertices for s in graph.maps):
        raise CommandError(f"environment '{graph.environment}' has no vertex {text}")
    return vertex


def _state(bus: "Bus") -> "State":
    from common import topics

    received = bus.subscribe(topics.STATE).wait(_STATE_S)
    if received is None:
        raise CommandError("the navigator does not tell its state: is it running? See vtr ps.")
    message: State = received.message
    return message
