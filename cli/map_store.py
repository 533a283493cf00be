"""Questions to a robot's map store, for ``vtr maps``."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

from cli.errors import CommandError
from common import topics
from common.bus import Bus
from common.messages import Done, GraphQuery, MapSummary, Restriction, Topology

_DEADLINE_S = 10.0


def list_maps(bus: Bus, environment: str | None) -> list[MapSummary]:
    """The stored maps of an environment, or of all, oldest first."""
    maps: list[MapSummary] = bus.ask(topics.MAPS, GraphQuery(environment=environment), timeout=_DEADLINE_S).maps
    return maps


def find(bus: Bus, text: str) -> MapSummary:
    """The map with an id, or with a part of it that no other map has at its beginning or end.

    Raises:
        CommandError: no map, or more than one, fits.
    """
    fitting = [m for m in list_maps(bus, None) if m.record.id.startswith(text) or m.record.id.endswith(text)]
    exact = [m for m in fitting if m.record.id == text]
    if len(exact or fitting) != 1 or not text:
        found = "no map" if not fitting else "more than one map"
        raise CommandError(f"{found} in the store fits '{text}': vtr maps ls lists them")
    return (exact or fitting)[0]


def stretch(bus: Bus, text: str) -> Restriction:
    """The vertices that ``MAP``, ``MAP:INDEX`` or ``MAP:FIRST-LAST`` mean.

    Raises:
        CommandError: it is no such text, or no map or vertex is meant by it.
    """
    map_text, colon, indices = text.partition(":")
    summary = find(bus, map_text)
    first, last = 0, summary.vertices - 1
    if colon:
        match = re.fullmatch(r"([0-9]{1,9})(?:-([0-9]{1,9}))?", indices)
        if match is None:
            raise CommandError(f"'{text}' is no stretch of a map: write MAP, MAP:INDEX or MAP:FIRST-LAST")
        first = int(match[1])
        last = int(match[2] or first)
    if not first <= last < summary.vertices:
        raise CommandError(
            f"map {summary.record.id} has vertices 0 to {summary.vertices - 1}, and no stretch '{indices}'"
        )
    return Restriction(map=summary.record.id, first=first, last=last)


def topology(bus: Bus, environment: str) -> Topology:
    """The graph of an environment."""
    answer: Topology = bus.ask(topics.TOPOLOGY, GraphQuery(environment=environment), timeout=_DEADLINE_S)
    return answer


def remove(bus: Bus, summary: MapSummary) -> Done:
    """Removes a map from the store."""
    query = GraphQuery(environment=summary.record.environment, map=summary.record.id)
    answer: Done = bus.ask(topics.REMOVE, query, timeout=_DEADLINE_S)
    return answer


def summary_json(summary: MapSummary) -> dict[str, Any]:
    """A map's figures as JSON holds them."""
    return {
        **summary.record.model_dump(mode="json"),
        "time": time_of(summary),
        "vertices": summary.vertices,
        "length_m": round(summary.length, 3),
        "bytes": summary.bytes,
        "finished": summary.finished,
        "start_place": summary.start_place or "",
        "end_place": summary.end_place or "",
        "sync": summary.sync.value,
    }


def details_json(summary: MapSummary, graph: Topology) -> dict[str, Any]:
    """A map's figures with its named places, the maps that spatial edges join it to, and what is restricted."""
    places = {name: str(vertex) for name, vertex in graph.places.items() if vertex.map_id == summary.record.id}
    return {
        **summary_json(summary),
        "places": places,
        "joined_to": _joined(summary.record.id, graph),
        "restricted": {
            f"{r.first}-{r.last}": (f"{r.speed:g} m/s" if r.speed else "blocked")
            + (f": {r.reason}" if r.reason else "")
            for r in graph.restrictions
            if r.map == summary.record.id
        },
    }


def time_of(summary: MapSummary) -> str:
    """When a map was begun, ISO 8601, UTC."""
    return datetime.fromtimestamp(summary.record.stamp / 1e9, tz=UTC).isoformat(timespec="seconds")


def _joined(map_id: str, graph: Topology) -> dict[str, int]:
    """Other maps, with how many spatial edges lead there."""
    ids = [summary.record.id for summary in graph.maps]
    count: dict[str, int] = {}
    for (k_a, _, k_b, _), spatial in zip(graph.edges.tolist(), graph.spatial.tolist(), strict=True):
        ends = {ids[k_a], ids[k_b]}
        if spatial and map_id in ends and len(ends) == 2:
            other = (ends - {map_id}).pop()
            count[other] = count.get(other, 0) + 1
    return count
