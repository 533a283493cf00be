"""The maps as growing columns: plans are those of columns that are built anew, at every size."""

from dataclasses import replace

import numpy as np
import pytest

from common.environment import MapTable, Model, Network, Theta, plan
from common.environment.told import map_told
from common.errors import GraphError
from services.fleet.catalog import Catalog, SharedMap, planned, unusable

MODEL = Model(periods_hours=(24.0, 168.0), weights=(1.0, 0.5), phases=(0.1, 0.2), trend_per_hour=1e-4)
HOUR = 3_600_000_000_000


def name(k):
    return f"20260601T{k:012d}-r1-000000"


def maps(count, places=12, seed=0):
    random = np.random.default_rng(seed)
    for k in range(count):
        start, end = random.choice(places, 2, replace=False)
        trouble = tuple(random.uniform(0, 0.5, 24).tolist()) if k % 5 == 0 else ()
        stamp = int(random.integers(0, 9_000) * HOUR)
        yield SharedMap(name(k), f"p{start}", f"p{end}", stamp, float(random.uniform(1, 99)), k % 3, "stereo", 1, 0,
                        trouble)  # fmt: skip


def made(catalog, without=(), alternatives=3):
    columns = catalog.columns("stereo")
    return planned(
        columns.view(), MODEL, ("p0", "p1"), 9_001.0, Theta(1.0, 0.3, 0.1), per_metre=False,
        without=unusable(columns, without), alternatives=alternatives,
    )  # fmt: skip


def test_plans_over_growing_columns_are_those_over_new_ones():
    catalog = Catalog()
    compared = 0
    for k, one in enumerate(maps(300)):
        catalog.add(one)
        if k % 23 == 22:
            table = MapTable.of([map_told(entry) for entry in catalog.page(None, 10_000)[0]])
            try:
                expected = plan(table, Network.of(table), MODEL, "p0", "p1", 9_001.0, Theta(1.0, 0.3, 0.1))
            except GraphError:
                continue
            found, _ = made(catalog)
            assert found.cost == pytest.approx(expected.cost)
            assert found.maps == expected.maps
            compared += 1
    assert compared > 5


def test_maps_that_a_robot_cannot_use_are_in_no_plan_and_no_reason():
    catalog = Catalog(maps(300))
    best, others = made(catalog)
    assert not set(best.maps) & set(others)
    second, _ = made(catalog, without=[best.maps[0]])
    assert best.maps[0] not in second.maps
    assert second.cost >= best.cost
    assert not any(best.maps[0] in sentence or "inf" in sentence for sentence in second.why)
    with pytest.raises(GraphError, match="no sequence"):
        made(catalog, without=[one.map for one in catalog])


def test_pages_are_in_order_and_end():
    catalog = Catalog(reversed(list(maps(25))))
    names, after, more = [], None, True
    while more:
        page, more = catalog.page(after, 7)
        names += [entry.map for entry in page]
        after = names[-1]
    assert names == [name(k) for k in range(25)]


def test_a_map_that_leads_nowhere_is_known_and_in_no_plan_and_each_sensor_has_its_own():
    catalog = Catalog([SharedMap(name(99), None, None, 0, 1.0, 1, "stereo", 1), *maps(2), *maps(2)])
    catalog.add(SharedMap("b", "p0", "p1", 0, 1.0, 0, "lidar", 1))
    assert name(99) in catalog
    assert len(catalog) == 3
    assert len(catalog.columns("stereo")) == 2
    with pytest.raises(GraphError, match="lidar, stereo"):
        catalog.columns("bearing")


def test_maps_that_are_gone_are_in_no_plan():
    catalog = Catalog(maps(300))
    best, _ = made(catalog)
    catalog.remove(set(best.maps))
    assert not set(made(catalog)[0].maps) & set(best.maps)
    assert len(catalog) == 300 - len(best.maps)


def test_trouble_that_is_reported_later_raises_the_cost():
    catalog = Catalog(maps(300))
    before, _ = made(catalog)
    catalog.set_trouble(before.maps[0], (1.0,) * 24)
    assert made(catalog)[0].cost > before.cost
    assert catalog[before.maps[0]].entry().trouble == [1.0] * 24


@pytest.mark.parametrize("others", [True, False])
def test_no_trouble_is_told_and_takes_back_what_there_was(others):
    catalog = Catalog(maps(300) if others else (replace(one, trouble=()) for one in maps(300)))
    before, _ = made(catalog)
    untroubled = next(one for one in before.maps if not catalog[one].trouble)
    for told in ((), (1.0,) * 24, ()):
        catalog.set_trouble(untroubled, told)
        after, _ = made(catalog)
        assert (after.cost > before.cost) == bool(told)
    assert (after.maps, after.cost) == (before.maps, before.cost)
