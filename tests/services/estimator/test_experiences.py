"""Recorded experiences lie beside the route where the graph says, and the few that help most are joined."""

from itertools import pairwise

import numpy as np
import pytest

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import MapRecord
from common.posegraph import Edge, PoseGraph
from services.estimator.experiences import ExperienceChoice, ExperienceSettings, RouteExperiences
from services.estimator.pipeline import Localized
from services.estimator.route_map import RouteMap

HOUR_NS = 3_600_000_000_000
NOON = 500_000 * HOUR_NS
SMALL = np.eye(6) * 1e-6


def record(stamp, parent=None):
    return MapRecord(
        id=new_map_id("r1", stamp),
        environment="yard",
        stamp=stamp,
        robot="r1",
        sensor="stereo",
        generation=0 if parent is None else 1,
        parent=parent,
    )


def shifted(metres, aside=0.0):
    return geometry.exp([metres, aside, 0.0, 0.0, 0.0, 0.0])


class Yard:
    """A straight taught route of 0.4 m steps, and repeats beside it."""

    def __init__(self, length=40):
        self.graph = PoseGraph("yard")
        self.route = self._drive(record(NOON), length)
        self.path = np.array([shifted(0.4 * i) for i in range(length)])

    def _drive(self, map_record, length):
        self.graph.add_experience(map_record)
        vertices = [VertexId(map_record.id, i) for i in range(length)]
        for vertex in vertices:
            self.graph.add_vertex(vertex)
        for a, b in pairwise(vertices):
            self.graph.add_edge(Edge(a, b, Uncertain(shifted(0.4), SMALL), spatial=False))
        return vertices

    def repeat(self, stamp, aside, localized):
        """A repeat beside the route, joined to it at the places that ``localized`` says."""
        vertices = self._drive(record(stamp, self.route[0].map_id), len(self.route))
        for i in localized:
            self.graph.add_edge(Edge(self.route[i], vertices[i], Uncertain(shifted(0.05, aside), SMALL), spatial=True))
        return vertices

    def experiences(self, **settings):
        return RouteExperiences(self.graph, self.route, self.path, ExperienceSettings(**settings))


def test_a_localized_vertex_lies_where_its_edge_says():
    yard = Yard()
    other = yard.repeat(NOON + HOUR_NS, 0.1, range(40))
    beside = yard.experiences()
    ((vertex, T),) = beside.near(7, [other[0].map_id])
    assert vertex == other[7]
    assert np.allclose(T.T, shifted(0.05, 0.1))


@pytest.mark.parametrize("gap", [range(10, 25), range(25), range(20, 40)])
def test_where_it_was_not_localized_odometry_carries_on(gap):
    yard = Yard()
    other = yard.repeat(NOON + HOUR_NS, 0.1, [i for i in range(40) if i not in gap])
    beside = yard.experiences(bridge=100.0)
    for i in gap:
        ((vertex, T),) = beside.near(i, [other[0].map_id])
        assert vertex == other[i]
        assert np.allclose(T.T, shifted(0.05, 0.1), atol=1e-9)
    ends = [T.covariance[0, 0] for i in (gap[0], gap[len(gap) // 2]) for _, T in beside.near(i, [other[0].map_id])]
    assert max(ends) > 1e-6


def test_odometry_is_not_trusted_for_longer_than_the_bridge():
    yard = Yard()
    other = yard.repeat(NOON + HOUR_NS, 0.1, [0])
    beside = yard.experiences(bridge=4.0)
    assert beside.near(10, [other[0].map_id])
    assert not beside.near(12, [other[0].map_id])


def test_an_experience_that_was_never_localized_is_nowhere():
    yard = Yard()
    other = yard.repeat(NOON + HOUR_NS, 0.1, [])
    assert not any(yard.experiences().near(i, [other[0].map_id]) for i in range(40))


def test_at_another_pass_of_a_crossing_route_nothing_is_laid():
    yard = Yard()
    # The second half comes back over the first.
    yard.path[20:] = [shifted(0.4 * (39 - i)) for i in range(20, 40)]
    other = yard.repeat(NOON + HOUR_NS, 0.0, [5])
    beside = yard.experiences(bridge=0.0)
    assert beside.near(5, [other[0].map_id])
    assert not beside.near(34, [other[0].map_id])


def test_before_any_success_youth_and_time_of_day_decide():
    stamps = {"morning": NOON - 4 * HOUR_NS, "noon": NOON, "old noon": NOON - 24 * 200 * HOUR_NS}
    choice = ExperienceChoice(stamps, ExperienceSettings())
    assert choice.ranking(NOON + 24 * HOUR_NS)[0] == "noon"
    assert choice.ranking(NOON + 20 * HOUR_NS)[0] == "morning"
    assert choice.ranking(NOON + 24 * HOUR_NS)[-1] == "old noon"


def test_success_outweighs_expectation_and_failure_is_forgiven_in_time():
    stamps = {"noon": NOON, "evening": NOON + 6 * HOUR_NS, "night": NOON + 12 * HOUR_NS}
    choice = ExperienceChoice(stamps, ExperienceSettings())
    now = NOON + 24 * HOUR_NS
    assert choice.ranking(now)[0] == "noon"
    for _ in range(30):
        choice.credit({"noon": 2, "evening": 60})
    assert choice.ranking(now)[0] == "evening"
    for _ in range(400):
        choice.credit({"night": 5})
    assert choice.ranking(now)[0] == "noon"


class Pipeline:
    def join(self, members):
        return [(name, float(T.T[0, 3])) for name, T in members]


def test_however_many_experiences_only_the_best_few_are_joined():
    yard = Yard()
    maps = [yard.repeat(NOON + (i + 1) * 24 * HOUR_NS, 0.1, range(40))[0].map_id for i in range(50)]
    settings = ExperienceSettings(most=3, window=0)
    route_map = RouteMap(yard.route, yard.path, Pipeline(), str, settings)
    assert len(route_map.at(3).members) == 1
    route_map.use(RouteExperiences(yard.graph, yard.route, yard.path, settings))
    now = NOON + 60 * 24 * HOUR_NS
    route_map.rank(now)
    joint = route_map.at(3)
    assert joint.members[0] == yard.route[3]
    assert [v.map_id for v in joint.members[1:]] == maps[:-4:-1]
    assert len(route_map.wanted(range(10))) == 40
    best = maps[10]
    for _ in range(30):
        result = Localized(True, Uncertain.identity(), 50, "plain", "", {}, (0, 0, 0, 0))
        route_map.credit(joint, result)
    assert best not in {v.map_id for v in route_map.at(3).members}


def test_a_member_whose_submap_is_not_here_is_left_out_until_it_is():
    yard = Yard()
    other = yard.repeat(NOON + HOUR_NS, 0.1, range(40))
    here = {yard.route[3]: "own"}
    route_map = RouteMap(yard.route, yard.path, Pipeline(), here.get, ExperienceSettings(window=0))
    route_map.use(yard.experiences())
    route_map.rank(NOON)
    assert route_map.at(2) is None
    assert route_map.at(3).members == (yard.route[3],)
    here[other[3]] = "other"
    assert route_map.at(3).members == (yard.route[3], other[3])
