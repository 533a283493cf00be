"""The page's small parts: names, thinned spectra, robots, and what a browser may ask."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import messages as m
from services.console.errors import BadArguments
from services.console.fleet.asked import CostsAsked, EnvironmentAsked, SimilarityAsked
from services.console.fleet.labels import period_text, place_name, robot_of, short_names
from services.console.fleet.robots import connected, shared
from services.console.fleet.spectrum import thinned
from tests.services.console.fleet.standin import entries

ID, TWIN = "20260621T110502000000-r1-00ab01", "20260621T110559000000-r1-00ab02"
RIGHT = {"environment": "farm", "at_hours": 5e5, "theta": [1, 0, 0]}


def test_a_map_is_named_by_its_time_and_robot_and_told_from_its_twin():
    assert short_names([ID]) == ["06-21 11:05 r1"]
    assert short_names([ID, TWIN]) == ["06-21 11:05 r1 00ab01", "06-21 11:05 r1 00ab02"]
    assert (robot_of(ID), robot_of("nonsense")) == ("r1", "")
    assert place_name(f"{ID}:17") == "06-21 11:05 r1:17"
    assert place_name("gate") == "gate"


@pytest.mark.parametrize(("hours", "text"), [(12.0, "12 h"), (24.0, "24 h"), (168.0, "7 days"), (8766.0, "1 year")])
def test_a_period_is_told_as_a_reader_would(hours, text):
    assert period_text(hours) == text


def test_a_thinned_spectrum_keeps_its_peaks():
    frequencies = np.linspace(0.005, 0.33, 20_000)
    power = np.random.default_rng(1).uniform(0.0, 0.1, len(frequencies))
    power[[137, 9000]] = 0.9, 0.8
    told = m.EnvironmentSpectrum(environment="farm", revision=1, frequencies=frequencies, power=power)
    periods, thin = thinned(told, 300)
    assert len(periods) <= 300
    assert np.all(np.diff(periods) > 0.0)
    assert np.sort(thin)[-2:].tolist() == [0.8, 0.9]
    assert periods[thin.argmax()] == 1.0 / frequencies[137]


def test_robots_are_connected_by_their_processes_and_a_state_counts_only_with_its_navigator():
    state = m.State(stamp=1, name=m.StateName.IDLE, environment="farm", since=1, reason="at rest", waiting_for="a goal")
    present = {
        "r1": frozenset({"navigator", "router"}), "r2": frozenset({"operator"}), "fleet": frozenset({"fleet"}),
        "r3": frozenset({"router"}),
    }  # fmt: skip
    found = connected(present, {"r1": state, "r2": state, "r3": state})
    assert sorted(found) == ["r1", "r3"]
    assert (found["r1"].state, found["r1"].waiting_for, found["r3"].state) == ("Idle", "a goal", "")
    maps = entries([("map1", "a", "b", "2026-06-01", 10.0), ("map2", "b", "c", "2026-06-02", 5.0)], robot="r9")
    assert (shared(maps)["r9"].maps, shared(maps)["r9"].metres) == (2, 15.0)


@pytest.mark.parametrize(
    "change",
    [{"theta": [1, 0]}, {"theta": [float("nan"), 0, 0]}, {"theta": [1e9, 0, 0]}, {"at_hours": -1}, {"at_hours": 1e300},
     {"environment": "../x"}, {"environment": ""}, {"sensor": "*"}, {"start": "a/b"}, {"goal": "x" * 999}, {"more": 1}],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_with_a_sentence(change):
    CostsAsked.of(RIGHT)
    with pytest.raises(BadArguments, match=next(iter(change))):
        CostsAsked.of(RIGHT | change)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
)
FIELDS = st.sampled_from(["environment", "sensor", "at_hours", "theta", "per_metre", "start", "goal", "end", "curves"])


@given(st.dictionaries(FIELDS | st.text(max_size=5), JSON, max_size=9))
def test_any_arguments_are_a_question_or_refused(arguments):
    for kind in (CostsAsked, EnvironmentAsked, SimilarityAsked):
        with contextlib.suppress(BadArguments):
            kind.of(arguments)
