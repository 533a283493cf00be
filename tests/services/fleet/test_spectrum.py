"""Known rhythms are recovered, noise has none, and what the times cannot tell is said."""

import json

import numpy as np
import pytest

from services.fleet.similarity import softmax_rows
from services.fleet.spectrum import Settings, of_maps, of_series
from tests.services.fleet.series import likeness_of, mixture, office_hours


def nearest(found, period):
    return int(np.abs(np.log(found.periods_hours / period)).argmin())


def angle_between(found, k, period, phase, hours):
    """How far a found rhythm is from a true one in the middle of its samples, degrees."""
    middle = 2 * np.pi * hours.mean()
    difference = (middle / found.periods_hours[k] - found.phases[k]) - (middle / period - phase)
    return abs(np.degrees(np.angle(np.exp(1j * difference))))


@pytest.mark.parametrize(
    ("count", "days", "periods", "noise"),
    [
        (24, 21, [24.0], 0.2),
        (40, 28, [12.0, 24.0, 168.0], 0.1),
        (60, 40, [12.0, 24.0, 168.0, 37.3], 0.2),
        (300, 90, [12.0, 24.0, 168.0, 37.3], 0.5),
        (10_000, 365, [12.0, 24.0, 168.0, 8.9], 1.0),
    ],
)
def test_a_mixture_is_taken_apart(count, days, periods, noise):
    for seed in range(2):
        hours, values, phases = mixture(np.random.default_rng(seed), count, days, periods, noise)
        found = of_series(hours, values)
        assert len(found.periods_hours) >= len(periods)
        for period, phase in zip(periods, phases, strict=True):
            k = nearest(found, period)
            assert found.periods_hours[k] == pytest.approx(period, rel=0.02)
            assert angle_between(found, k, period, phase, hours) < 10
            assert found.significance[k] <= 0.01
        strong = found.weights > 0.4 * found.weights[0]
        assert strong.sum() == len(periods)


@pytest.mark.parametrize(("count", "days"), [(24, 28), (150, 60), (2000, 120)])
def test_noise_has_no_rhythm(count, days):
    claims = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        found = of_series(np.sort(rng.uniform(0, 24 * days, count)), rng.normal(size=count))
        claims += len(found.periods_hours) > 0
        assert found.reason
    assert claims <= 2


def test_noise_that_is_restless_over_days_has_no_rhythm_either():
    rng = np.random.default_rng(2)
    hours = np.arange(0, 24 * 200, 1.0)
    values = np.zeros(len(hours))
    for k in range(1, len(hours)):
        values[k] = 0.97 * values[k - 1] + rng.normal()
    assert len(of_series(hours, values).periods_hours) <= 1
    day = of_series(hours, values + 3 * np.cos(2 * np.pi * hours / 24))
    assert day.periods_hours[0] == pytest.approx(24, rel=0.02)


def test_the_strongest_comes_first_and_weights_keep_the_amplitudes_ratio():
    hours, values, _ = mixture(np.random.default_rng(1), 1000, 60, [24.0, 12.0, 100.0], 0.1, [1.0, 0.5, 2.0])
    found = of_series(hours, values)
    assert found.periods_hours == pytest.approx([100, 24, 12], rel=0.01)
    assert found.weights / found.weights[1] == pytest.approx([2, 1, 0.5], abs=0.05)
    assert found.weights.mean() == pytest.approx(1.0, abs=0.02)
    scaled = of_series(hours, 1e-6 * values + 50)
    assert scaled.weights == pytest.approx(found.weights, abs=1e-4)


def test_the_axis_of_time_may_begin_anywhere():
    hours, values, _ = mixture(np.random.default_rng(4), 400, 60, [24.0, 37.3], 0.3)
    near, far = of_series(hours, values), of_series(hours + 472_000.0, values)
    assert far.periods_hours == pytest.approx(near.periods_hours, rel=1e-3)
    for found, at in ((near, hours), (far, hours + 472_000.0)):
        waves = [np.cos(2 * np.pi * at / T - p) for T, p in zip(found.periods_hours, found.phases, strict=True)]
        assert np.corrcoef(found.weights @ np.array(waves), values)[0, 1] > 0.95


@pytest.mark.parametrize("periods", [[24.0], [12.0, 24.0], [24.0, 168.0]])
def test_office_hours_cannot_tell_a_day_from_half_a_day(periods):
    rng = np.random.default_rng(3)
    hours = office_hours(rng, 500, 12)
    values = sum(np.cos(2 * np.pi * hours / T - 1) for T in periods) + 0.3 * rng.normal(size=len(hours))
    found = of_series(hours, values)
    assert "tell 24 h from 12 h" in found.reason
    assert [round(T) for T in found.periods_hours] == [round(T) for T in periods if T > 48]


def test_maps_of_the_same_hours_of_three_days_cannot_tell_either():
    rng = np.random.default_rng(0)
    hours = np.sort(np.concatenate([24 * day + rng.uniform(15.5, 23.5, 8) for day in range(3)]))
    found = of_maps(hours, likeness_of(rng, hours, [24.0], 0.2))
    assert len(found.periods_hours) == 0
    assert "tell 24 h from 12 h" in found.reason


def test_few_samples_over_years_show_a_day_and_a_year():
    hours, values, _ = mixture(np.random.default_rng(0), 60, 3 * 365, [24.0, 8765.8], 0.2)
    assert sorted(of_series(hours, values).periods_hours) == pytest.approx([24, 8765.8], rel=0.02)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_any_unit_will_do(scale):
    hours, values, _ = mixture(np.random.default_rng(0), 200, 30, [24.0], 0.2)
    assert of_series(hours, scale * values).periods_hours == pytest.approx([24], rel=0.02)


def test_even_times_show_no_period_below_twice_their_step():
    hours = np.arange(0, 24 * 60, 24.0)
    found = of_series(hours, np.cos(2 * np.pi * hours / 168) + 0.1 * np.random.default_rng(0).normal(size=len(hours)))
    assert found.periods_hours == pytest.approx([168], rel=0.02)
    assert "periods below" in found.reason


@pytest.mark.parametrize(
    ("hours", "values", "words"),
    [
        ([], [], "0 samples"),
        ([1.0], [2.0], "1 sample,"),
        (np.arange(5.0), np.arange(5.0), "at least 8"),
        (np.zeros(30), np.arange(30.0), "within 0.0 h"),
        (np.arange(0, 90, 3.0), np.ones(30), "all the same"),
    ],
)
def test_too_little_is_said_to_be_too_little(hours, values, words):
    found = of_series(np.array(hours), np.array(values))
    assert found.reason.startswith("not enough data")
    assert words in found.reason
    assert len(found.periods_hours) == 0


def test_the_answer_is_the_same_each_time_and_in_any_order():
    rng = np.random.default_rng(6)
    hours, values, _ = mixture(rng, 60, 30, [24.0, 37.3], 0.3)
    order = rng.permutation(60)
    assert (
        of_series(hours, values).periods_hours.tolist() == of_series(hours[order], values[order]).periods_hours.tolist()
    )


def test_all_rows_of_a_similarity_matrix_serve_and_the_softmax_does_not_matter():
    rng = np.random.default_rng(0)
    hours = np.sort(rng.uniform(0, 24 * 14, 40))
    matrix = likeness_of(rng, hours, [24.0], 0.5)
    found = of_maps(hours, matrix)
    assert found.periods_hours[0] == pytest.approx(24, rel=0.02)
    assert abs(found.phases[0]) < np.radians(10)
    for beta in (0.01, 0.3):
        soft = of_maps(hours, softmax_rows(matrix, beta))
        assert soft.periods_hours[0] == pytest.approx(24, rel=0.02)
        assert soft.weights[0] == pytest.approx(found.weights[0], abs=1e-3)


def test_the_rate_of_lasting_change_is_found():
    rng = np.random.default_rng(1)
    hours = np.sort(rng.uniform(0, 24 * 60, 60))
    assert of_maps(hours, likeness_of(rng, hours, [24.0], 0.3)).trend_per_hour == 0.0
    found = of_maps(hours, likeness_of(rng, hours, [24.0], 0.3, rate=1 / 300))
    assert found.trend_per_hour == pytest.approx(1 / 300, rel=0.4)


def test_maps_that_are_alike_by_chance_have_no_rhythm():
    claims = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        hours = np.sort(rng.uniform(0, 24 * 14, 24))
        looks = rng.normal(size=(24, 6))
        claims += len(of_maps(hours, looks @ looks.T).periods_hours) > 0
    assert claims <= 1


@pytest.mark.parametrize("name", ["env3", "env4", "env5"])
def test_the_thesis_s_small_environments_claim_nothing(data_dir, name):
    content = json.loads((data_dir / "chronorobotics_similarity" / f"{name}.json").read_text())
    hours = np.array([stamp[0] for stamp in content["timestamp"]]) / 3600
    found = of_maps(hours, np.array(content["Similarity_matrix"]))
    assert len(found.periods_hours) == 0
    assert found.reason.startswith("not enough data")


def test_people_s_presence_repeats_by_the_day_and_by_the_week(data_dir):
    recorded = np.load(data_dir / "presence_aruba" / "aruba1.npz")
    found = of_series(recorded["t"] / 3600.0, recorded["presence"][:, 0].astype(float))
    assert found.periods_hours[0] == pytest.approx(24, rel=0.01)
    assert found.periods_hours[nearest(found, 168)] == pytest.approx(168, rel=0.01)


def test_the_level_of_significance_is_the_user_s():
    hours, values, _ = mixture(np.random.default_rng(8), 30, 20, [24.0], 1.3)
    chances = [len(of_series(hours, values, Settings(level=level)).periods_hours) for level in (0.005, 0.5)]
    assert chances[0] <= chances[1]


def test_routes_that_are_not_compared_with_each_other_are_searched_jointly():
    rng = np.random.default_rng(0)
    hours = np.sort(rng.uniform(0, 24 * 20, 48))
    groups = np.arange(48) % 4
    alike = likeness_of(rng, hours, [24.0], 0.3)
    one = groups == 0
    apart = np.where(groups[:, None] == groups, alike, 0.0)
    found = of_maps(hours, apart, groups=groups)
    assert found.periods_hours.tolist() == pytest.approx([24.0], rel=0.02)
    assert found.significance[0] <= of_maps(hours[one], alike[np.ix_(one, one)]).significance.min(initial=1.0)
    spoilt = np.where(groups[:, None] == groups, alike, rng.normal(size=alike.shape))
    assert of_maps(hours, spoilt, groups=groups).weights == pytest.approx(found.weights)


def test_routes_of_which_each_has_one_map_tell_nothing():
    hours = np.arange(20.0)
    assert "all the same" in of_maps(hours, np.eye(20), groups=np.arange(20)).reason
