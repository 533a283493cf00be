"""The thesis's printed numbers, and what holds for any environment."""

import numpy as np
import pytest

from common.environment import MODES, Environment, MapTable, Model, Theta, map_costs
from common.environment.costs import cyclic_cost, drift_cost, similarity_bounds, similarity_cost, trend_cost
from common.environment.model import parse_time
from common.environment.table import hours_of
from tests.common.environment.thesis import EXPERIMENT_2, EXPERIMENT_3, environment

TABLE_4_5 = {
    "2023-05-08 16:00:00": [0.022, 0.023, 0.032, 0.033, 0.034, 0.376, 0.379, 0.386, 0.390],
    "2023-05-08 22:00:00": [0.352, 0.347, 0.322, 0.319, 0.316, 0.015, 0.014, 0.013, 0.012],
}
TABLES_4_9_TO_4_13 = {
    (1.0, 0.0, 0.0): [0.071, 0.078, 0.409],
    (0.7, 0.3, 0.0): [0.350, 0.262, 0.419],
    (0.3, 0.7, 0.0): [0.721, 0.509, 0.432],
}


def costs(rows, at, theta=(1.0, 0.0, 0.0), model=None, **options):
    found = Environment.model_validate(environment(rows, model))
    return map_costs(MapTable.of(found.maps), found.model, hours_of(parse_time(at)), Theta(*theta), **options)


@pytest.mark.parametrize("at", TABLE_4_5)
def test_table_4_5(at):
    assert costs(EXPERIMENT_2, at).cost == pytest.approx(TABLE_4_5[at], abs=1e-3)


@pytest.mark.parametrize("theta", TABLES_4_9_TO_4_13)
def test_tables_4_9_4_11_and_4_13(theta):
    found = costs(EXPERIMENT_3, "2023-05-08 16:00:00", theta)
    assert found.cost == pytest.approx(TABLES_4_9_TO_4_13[theta], abs=1e-3)
    # The thesis prints 0.422 for the third map, whose final costs are those of 0.443.
    assert found.distance == pytest.approx([1.0, 0.694, 0.443], abs=1e-3)


def test_figure_3_4_a_week_ago_is_best_then_whole_days():
    lag = np.arange(1.0, 240.0)
    cost = cyclic_cost(Model(periods_hours=[24, 168], weights=[1, 1], phases=[0, 0]), lag)
    assert lag[cost.argmin()] == 168.0
    assert cost.min() == pytest.approx(0.0, abs=1e-3)
    minima = lag[1:-1][(cost[1:-1] < cost[:-2]) & (cost[1:-1] < cost[2:])]
    assert minima == pytest.approx(24.0 * np.arange(1, 10), abs=1.0)
    days = cost[23::24]
    assert days == pytest.approx([0.5 - 0.25 * (1 + np.cos(2 * np.pi * day / 7)) for day in range(1, 10)], abs=1e-3)


@pytest.mark.parametrize("count", range(6))
def test_the_equations_are_those_of_the_thesis(count):
    rng = np.random.default_rng(count)
    periods, weights, phases = rng.uniform(0.5, 1e4, count), rng.uniform(-3, 3, count), rng.uniform(-10, 10, count)
    components, rate = list(zip(periods, weights, phases, strict=True)), float(rng.uniform(0, 0.1))
    model = Model(periods_hours=periods, weights=weights, phases=phases, trend_per_hour=rate)
    lag = np.linspace(-1e3, 1e4, 501)
    waves = [w * np.cos(2 * np.pi * lag / T - phi) for T, w, phi in components]
    cyclic = 0.5 - sum(waves, np.zeros(501)) / (2 * max(1, len(components)))
    assert cyclic_cost(model, lag) == pytest.approx(cyclic, abs=1e-9)
    trend = np.where(lag > 0, 1 - np.exp(-rate * np.maximum(lag, 0)), 0)
    assert similarity_cost(model, lag) == pytest.approx(cyclic + trend, abs=1e-9)
    lower, upper = similarity_bounds(model)
    assert (lower - 1e-9 <= similarity_cost(model, lag)).all()
    assert (similarity_cost(model, lag) <= upper + 1e-9).all()


def test_a_map_of_the_future_has_no_trend_cost():
    assert trend_cost(0.5, np.array([-100.0, 0.0, 2.0])) == pytest.approx([0.0, 0.0, 1 - np.exp(-1.0)])


def test_drift_is_zero_for_taught_maps_and_grows_below_one():
    drift = drift_cost(np.array([0, 1, 3, 50, 10**9]))
    assert drift[0] == 0.0
    assert (np.diff(drift) > 0).all()
    assert drift[-1] == pytest.approx(1.0)


def test_maps_without_length_and_environments_without_maps_cost_nothing_strange():
    assert costs([("a", "A", "B", "2023-05-07", 0.0)], "2023-05-07", (0, 1, 0)).cost.tolist() == [0.0]
    assert len(costs([], "2023-05-07").cost) == 0


@pytest.mark.parametrize("per_metre", [False, True])
def test_no_edge_is_negative_whatever_the_weights(per_metre):
    rng = np.random.default_rng(0)
    maps = zip(rng.uniform(0, 500, 20), rng.integers(0, 9, 20), rng.integers(0, 400, 20), strict=True)
    rows = [(str(k), "A", "B", f"2023-05-07T{h % 24:02d}:00", d, n) for k, (d, n, h) in enumerate(maps)]
    model = {"periods_hours": [24, 31], "weights": [3, -2], "phases": [1, 2], "trend_per_hour": 0.01}
    for theta in rng.uniform(-2, 2, (50, 3)).tolist():
        assert (costs(rows, "2023-05-09", theta, model, per_metre=per_metre).edge >= 0.0).all()


def test_positive_weights_add_up_the_cost_and_a_negative_one_seeks_the_term():
    found = costs(EXPERIMENT_3, "2023-05-08 16:00:00", (0.7, 0.3, 0.0))
    assert found.edge == pytest.approx(found.cost)
    sought = costs(EXPERIMENT_3, "2023-05-08 16:00:00", MODES["explore"].values)
    assert sought.cost == pytest.approx(-sought.similarity)
    assert sought.edge == pytest.approx(1.0 - sought.similarity)


def test_per_metre_weighs_likeness_and_drift_by_the_length():
    found = costs(EXPERIMENT_3, "2023-05-08 16:00:00", (0.7, 0.3, 0.0), per_metre=True)
    assert found.cost == pytest.approx(found.distance * (0.7 * found.similarity + 0.3))


def test_weights_must_be_finite():
    with pytest.raises(ValueError, match="finite"):
        Theta(float("nan"))
