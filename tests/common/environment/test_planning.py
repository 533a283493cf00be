"""Plans against brute force over all simple paths, the thesis's routes, and the sentences that explain."""

import itertools

import numpy as np
import pytest

from common.environment import MODES, Environment, MapTable, Model, Network, Theta, map_costs, plan
from common.environment.model import parse_time
from common.environment.table import hours_of
from common.errors import GraphError
from tests.common.environment.thesis import EXPERIMENT_2, EXPERIMENT_3, environment

MODEL = Model(periods_hours=[24, 168], weights=[1.2, 0.8], phases=[0.3, -0.2], trend_per_hour=1e-4)


def planned(rows, start, goal, at, theta=(1.0, 0.0, 0.0), **options):
    found = Environment.model_validate(environment(rows))
    maps = MapTable.of(found.maps)
    hours = hours_of(parse_time(at))
    return plan(maps, Network.of(maps), found.model, start, goal, hours, Theta(*theta), **options)


def random_maps(rng, places, count):
    """Maps between random places, parallel ones and loops among them."""
    start, end = rng.integers(0, places, (2, count)).astype(np.int32)
    return MapTable(
        names=[f"m{k}" for k in range(count)],
        places=[f"p{k}" for k in range(places)],
        start=start,
        end=end,
        hours=rng.uniform(0, 2000, count),
        length=rng.uniform(0, 100, count),
        generation=rng.integers(0, 20, count),
    )


def least_of_all_paths(maps, edge_costs, start, goal):
    """The least summed cost over all paths without a place twice, infinite where there is none."""
    best = np.inf

    def walk(place, visited, total):
        nonlocal best
        if place == goal:
            best = min(best, total)
            return
        for edge in np.flatnonzero(maps.start == place):
            if (there := int(maps.end[edge])) not in visited:
                walk(there, visited | {there}, total + edge_costs[edge])

    walk(start, {start}, 0.0)
    return best


def test_plans_equal_brute_force_on_a_thousand_random_graphs():
    rng = np.random.default_rng(5)
    signs = itertools.cycle(itertools.product((-1.0, 0.0, 1.0), repeat=3))
    without_a_way = 0
    for _ in range(1000):
        maps = random_maps(rng, places=int(rng.integers(2, 7)), count=int(rng.integers(1, 16)))
        theta, per_metre = Theta(*(sign * rng.uniform(0.1, 2) for sign in next(signs))), bool(rng.integers(2))
        costs = map_costs(maps, MODEL, 2100.0, theta, per_metre=per_metre)
        expected = least_of_all_paths(maps, costs.edge, 0, 1)
        arguments = (maps, Network.of(maps), MODEL, "p0", "p1", 2100.0, theta)
        if np.isinf(expected):
            without_a_way += 1
            with pytest.raises(GraphError, match="no sequence"):
                plan(*arguments, per_metre=per_metre)
            continue
        found = plan(*arguments, per_metre=per_metre)
        assert found.cost == pytest.approx(expected, abs=1e-12)
        assert maps.start[found.edges[0]] == 0
        assert maps.end[found.edges[-1]] == 1
        assert (maps.end[found.edges[:-1]] == maps.start[found.edges[1:]]).all()
        assert len(found.why) == len(found.maps) + 1
    assert 100 < without_a_way < 900


def test_the_thesis_s_second_experiment_drives_by_day_over_the_maps_of_the_day():
    assert planned(EXPERIMENT_2, "A", "G", "2023-05-08 16:00:00").maps == ["map1", "map2", "map3", "map4", "map5"]


@pytest.mark.parametrize(
    ("theta", "chosen"), [((1, 0, 0), "map1"), ((0.7, 0.3, 0), "map2"), ((0.3, 0.7, 0), "map3"), ((-1, 0, 0), "map3")]
)
def test_the_thesis_s_third_experiment_weighs_likeness_against_distance(theta, chosen):
    assert planned(EXPERIMENT_3, "S", "G", "2023-05-08 16:00:00", theta).maps == [chosen]


def test_a_sum_per_map_favours_few_maps_and_per_metre_does_not():
    hour = "2023-05-07 12:00:00"
    rows = [("long", "A", "C", "2023-05-07 16:00:00", 100.0)]
    rows += [(f"short{k}", p, q, "2023-05-07 14:30:00", 40.0) for k, (p, q) in enumerate(["AB", "BC"])]
    rows += [("short2", "C", "D", "2023-05-07 14:30:00", 40.0)]
    assert planned(rows, "A", "C", "2023-05-08 12:00:00").maps == ["short0", "short1"]
    rows[0] = ("long", "A", "C", "2023-05-07 15:30:00", 100.0)
    assert planned(rows, "A", "C", hour).maps == ["long"]
    assert planned(rows, "A", "C", hour, per_metre=True).maps == ["short0", "short1"]


def test_of_routes_that_cost_the_same_the_one_of_fewest_maps_is_taken():
    rows = [
        ("ab", "A", "B", "2023-05-07", 1.0),
        ("bc", "B", "C", "2023-05-07", 1.0),
        ("ac", "A", "C", "2023-05-07", 9.0),
    ]
    assert planned(rows, "A", "C", "2023-05-07", (0, 0, 0)).maps == ["ac"]


def test_every_choice_is_explained():
    rows = [*EXPERIMENT_2, ("night1", "A", "C", "2023-05-07 23:00:00", 18.0)]
    why = planned(rows, "A", "G", "2023-05-08 16:00:00", MODES["robust"].values).why
    assert "cheapest of the 2 maps from A to C" in why[0]
    assert "night1" in why[0]
    assert "only map from C to D" in why[1]
    assert "the shortest (map8, map5), 44.9 m, costs 0.422" in why[-1]
    assert "also the shortest" in planned(EXPERIMENT_3, "S", "G", "2023-05-08", MODES["shortest"].values).why[-1]


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ("A", "Gate", ["no place 'Gate'", "A, B, C"]),
        ("A", "g", ["no place 'g'"]),
        ("A", "A", ["both 'A'"]),
        ("G", "A", ["no sequence", "no map leads anywhere"]),
        ("F", "B", ["no sequence", "maps lead to G"]),
    ],
)
def test_what_cannot_be_planned_is_said(start, goal, words):
    with pytest.raises(GraphError) as refusal:
        planned(EXPERIMENT_2, start, goal, "2023-05-08 16:00:00")
    assert all(word in str(refusal.value) for word in words)
