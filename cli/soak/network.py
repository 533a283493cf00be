"""A network of routes in a larger world: a ring, a detour beside a part of it, and named places around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cli.demo.driver import DriverSettings
from cli.demo.human import Human
from cli.demo.recorder import Recording
from cli.demo.story import Story
from cli.errors import CommandError
from common import topics
from common.geometry import Array
from common.ids import VertexId
from common.messages import Command, GraphQuery, NamePlace, State, StateName
from common.posegraph import PoseGraph, from_topology

PLACES = ("north", "east", "south", "west")
_PACE = DriverSettings(speed=1.1, acceleration=1.0)
_AROUND = 3
ASIDE_M = 0.8
_OVER_M = 2.0
"""The ring's last stretch runs so far beside its first one, to be merged there."""
_AREA_PER_METRE = 0.5
_STATE_S = 60.0
_ARRIVES_S = 900.0


def world_tables(metres: float, slip: float) -> str:
    """TOML of a world that has room for a route of so many metres, and slippery ground."""
    extent = max(96.0, _AREA_PER_METRE * metres + 20.0)
    more = 0.8 * (extent / 96.0) ** 2
    counts = {"trees": 40, "bushes": 26, "boxes": 16, "stones": 140, "tufts": 420, "houses": 4, "walls": 6, "fences": 4}
    scene = "".join(f"{name} = {math.ceil(count * more)}\n" for name, count in counts.items())
    return (
        f"\n[sensors.world.scene]\nroute_length = {metres}\nextent = {extent}\n{scene}"
        f"\n[sensors.world.base]\nslip = {slip}\n"
    )


@dataclass(frozen=True, slots=True)
class Network:
    """What was taught: the ids of its maps, and the paths (N, 2) that the robot truly drove then."""

    maps: list[str]
    paths: list[Array]

    def metres(self) -> float:
        """Of all of its routes."""
        return sum(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in self.paths)


def teach(story: Story) -> Network:
    """Teaches all of it, by hand, and names its places."""
    route = story.route()
    story.put_down(*route[0])
    ring, taught = story.teach(route, _PACE, (PLACES[0], "gap"))
    closing = np.concatenate([_straight(route[-1], route[0]), route[: _index_of(route, _OVER_M)]])
    maps, paths = [ring], [_xy(taught)]
    count = _vertices(story)[ring]
    part = route[_index_of(route, 20.0) : _index_of(route, 60.0)]
    for path, leaves, meets in (
        (closing, count - 1, round(count * _OVER_M / len(route) * 10)),
        (beside(part), round(count * 200 / len(route)), round(count * 600 / len(route))),
    ):
        more, driven = _branch(story, path, VertexId(ring, leaves), VertexId(ring, meets))
        maps.append(more)
        paths.append(_xy(driven))
    environment = _state(story).environment
    for k, place in enumerate(PLACES):
        vertex = VertexId(ring, k * count // len(PLACES))
        story.bus.ask(topics.NAME_PLACE, NamePlace(environment=environment, place=place, vertex=vertex), timeout=5.0)
    return Network(maps, paths)


def graph_of(story: Story) -> PoseGraph:
    """The whole graph, as the store has it now."""
    query = GraphQuery(environment=_state(story).environment)
    return from_topology(story.bus.ask(topics.TOPOLOGY, query, timeout=10.0))


def _branch(story: Story, path: Array, leaves: VertexId, meets: VertexId) -> tuple[str, Recording]:
    """Teaches a map that leaves a vertex and is merged at another one."""
    story.put_down(*path[0])
    ask = story.bus.ask
    ask(topics.MISSION, Command(action="teach", vertex=leaves), timeout=20.0)
    story.await_(lambda: _state(story).name is StateName.TEACH_BRANCH, "the robot branches off", _STATE_S)
    human = Human(story.bus, path, _PACE)
    if not human.arrived.wait(_ARRIVES_S):
        raise CommandError("the human did not arrive")
    size = _vertices(story)[meets.map_id]
    around = range(max(meets.index - _AROUND, 0), min(meets.index + _AROUND + 1, size))
    ask(topics.MISSION, Command(action="merge", candidates=[VertexId(meets.map_id, k) for k in around]), timeout=10.0)
    story.await_(lambda: _state(story).closure is not None, "a loop closure is offered", _STATE_S)
    ask(topics.MISSION, Command(action="confirm"), timeout=30.0)
    return story.maps()[-1].record.id, human.stop()


def _state(story: Story) -> State:
    received = story.bus.subscribe(topics.STATE)
    try:
        found = received.wait(5.0)
    finally:
        received.close()
    if found is None:
        raise CommandError("the navigator does not tell its state")
    message: State = found.message
    return message


def _vertices(story: Story) -> dict[str, int]:
    return {summary.record.id: summary.vertices for summary in story.maps()}


def _xy(recording: Recording) -> Array:
    return recording.poses()[:, :2, 3]


def _index_of(route: Array, metres: float) -> int:
    steps = np.linalg.norm(np.diff(route[:, :2], axis=0), axis=1)
    return int(np.searchsorted(np.cumsum(steps), metres)) + 1


def _straight(a: Array, b: Array, step: float = 0.1) -> Array:
    """Poses (N, 3) from one place to another, without either."""
    count = max(int(np.linalg.norm(b[:2] - a[:2]) / step), 2)
    share = np.linspace(0.0, 1.0, count + 1)[:-1, None]
    xy = a[:2] + share * (b[:2] - a[:2])
    heading = np.full(count, np.arctan2(b[1] - a[1], b[0] - a[0]))
    return np.column_stack([xy, heading])


def beside(path: Array) -> Array:
    """A path that leaves another one, runs beside it, and comes back."""
    share = np.linspace(0.0, 1.0, len(path))
    aside = ASIDE_M * np.sin(np.pi * share) ** 2
    left = np.stack([-np.sin(path[:, 2]), np.cos(path[:, 2])], axis=1)
    xy = path[:, :2] + aside[:, None] * left
    steps = np.gradient(xy, axis=0)
    return np.column_stack([xy, np.arctan2(steps[:, 1], steps[:, 0])])
