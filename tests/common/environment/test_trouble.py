"""What repeats tell of maps: trouble at an hour of the day, and what it does to costs and plans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.environment import Environment, MapTable, Model, Network, Theta, map_costs, plan
from common.environment.model import environment_json
from common.environment.trouble import HOURS, PRIOR_M, at_hour, shares

NOON = 12.0


def at(hour, metres, lost):
    rows = np.zeros((2, HOURS))
    rows[:, hour] = metres, lost
    return shares(*rows)


def test_a_repeat_tells_of_its_own_hour_and_little_of_others():
    found = at(12, 100.0, 80.0)
    assert found[12] == pytest.approx(80.0 / (100.0 + PRIOR_M))
    assert found[11] == pytest.approx(found[13])
    assert 0.3 < found[13] < found[12]
    assert found[0] < 0.01


def test_midnight_is_one_hour_from_eleven():
    found = at(0, 100.0, 80.0)
    assert found[23] == pytest.approx(found[1])


def test_one_bad_metre_says_little_and_many_good_ones_forgive():
    assert at(9, 1.0, 1.0)[9] < 0.05
    assert at(9, 1000.0, 50.0)[9] < 0.05


@given(
    metres=st.lists(st.floats(0, 1e5), min_size=HOURS, max_size=HOURS),
    parts=st.lists(st.floats(0, 1), min_size=HOURS, max_size=HOURS),
)
def test_trouble_is_a_share(metres, parts):
    found = shares(np.array(metres), np.array(metres) * parts)
    assert ((found >= 0) & (found <= 1)).all()


def test_between_hours_it_is_in_between():
    rows = np.arange(HOURS, dtype=np.float32)[None] / HOURS
    assert at_hour(rows, 6.5)[0] == pytest.approx(6.5 / HOURS)
    assert at_hour(rows, 24 * 9 + 23.5)[0] == pytest.approx(11.5 / HOURS)


def two_maps(trouble=()):
    maps = [
        {"name": name, "start": "a", "end": "b", "timestamp": "2026-06-01T12:00:00", "length": 10.0}
        for name in ("first", "second")
    ]
    maps[0]["trouble"] = list(trouble)
    return Environment(name="yard", maps=maps)


def test_trouble_raises_a_map_s_cost_and_another_one_is_chosen():
    environment = two_maps([0.5] * HOURS)
    table = MapTable.of(environment.maps)
    costs = map_costs(table, Model(), NOON, Theta())
    assert costs.cost.tolist() == [1.0, 0.5]
    found = plan(table, Network.of(table), Model(), "a", "b", NOON, Theta())
    assert found.maps == ["second"]
    assert "trouble" not in found.why[0].split(";")[0]
    assert "trouble of repeats at this hour 0.500" in found.why[0]
    assert plan(table, Network.of(table), Model(), "a", "b", NOON, Theta(trouble=0.0)).maps == ["first"]


def test_without_reports_costs_are_those_of_the_thesis():
    table = MapTable.of(two_maps().maps)
    assert table.trouble is None
    assert map_costs(table, Model(), NOON, Theta()).cost.tolist() == [0.5, 0.5]
    assert "trouble" not in environment_json(two_maps())["maps"][0]


def test_closed_maps_are_not_driven_on():
    table = MapTable.of(two_maps().maps)
    closed = np.array([True, False])
    assert plan(table, Network.of(table), Model(), "a", "b", NOON, Theta(), closed=closed).maps == ["second"]
    with pytest.raises(Exception, match="no sequence of maps"):
        plan(table, Network.of(table), Model(), "a", "b", NOON, Theta(), closed=np.array([True, True]))


def test_trouble_is_never_sought():
    with pytest.raises(ValueError, match="cannot be sought"):
        Theta(trouble=-1.0)


def test_a_file_s_trouble_has_a_share_for_each_hour():
    with pytest.raises(ValueError, match="24 shares"):
        two_maps([0.5] * 23)
