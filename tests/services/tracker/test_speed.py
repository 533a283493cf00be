import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.tracker.limits import Drive, LimitError, Limits
from services.tracker.speed import (
    CautionSettings,
    braking_bound,
    caution,
    checked_limits,
    limit_between,
    speed_profile,
)

LIMITS = Limits(speed=1.2, acceleration=0.5, deceleration=0.4, lateral_acceleration=0.6, turn_rate=0.8)


def profile(curvature):
    s = 0.1 * np.arange(len(curvature))
    return s, speed_profile(s, np.asarray(curvature), LIMITS)


def test_curves_are_driven_within_lateral_acceleration_and_turn_rate():
    curvature = np.concatenate([np.zeros(100), np.full(50, 1.0), np.zeros(100), np.full(50, -3.0), np.zeros(100)])
    _, speed = profile(curvature)
    assert (speed**2 * np.abs(curvature) <= LIMITS.lateral_acceleration + 1e-9).all()
    assert (speed * np.abs(curvature) <= LIMITS.turn_rate + 1e-9).all()
    assert speed.max() == pytest.approx(LIMITS.speed)


def test_every_speed_can_be_reached_and_braked_from():
    s, speed = profile(np.concatenate([np.zeros(60), np.full(10, 2.0), np.zeros(60)]))
    gain = np.diff(speed**2) / (2.0 * np.diff(s))
    assert gain.max() <= LIMITS.acceleration + 1e-9
    assert gain.min() >= -LIMITS.deceleration - 1e-9
    assert speed[-1] == 0.0


def test_full_speed_while_localized_and_slower_the_longer_it_is_lost():
    settings, known = CautionSettings(), 1e-4 * np.eye(6)
    assert caution(0.0, 0.0, known, settings) == 1.0
    shares = [caution(metres, 0.0, known, settings) for metres in (3.0, 5.0, 7.0, 100.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] == pytest.approx(settings.slowest)
    assert caution(0.0, 5.0, known, settings) < 1.0
    assert caution(0.0, 0.0, 0.09 * np.eye(6), settings) < 1.0


@pytest.mark.parametrize("bad", [(np.nan, 0.0, 1.0), (0.0, np.inf, 1.0), (0.0, 0.0, np.nan)])
def test_slowest_for_what_is_not_finite(bad):
    metres, seconds, variance = bad
    assert caution(metres, seconds, variance * np.eye(6), CautionSettings()) == CautionSettings().slowest


def test_a_stretch_s_limit_holds_from_its_vertex_to_the_next_and_nowhere_else():
    vertex_s, limits = np.array([0.0, 1.0, 2.0, 3.0]), np.array([np.inf, 0.5, 0.8, np.inf])
    s = np.array([0.0, 0.7, 1.0, 1.4, 1.9, 2.1, 2.9, 3.0])
    assert limit_between(s, vertex_s, limits).tolist() == [np.inf, np.inf, 0.5, 0.5, 0.5, 0.8, 0.8]
    assert limit_between(np.array([0.9, 1.2]), vertex_s, limits).tolist() == [0.5]


def test_vertices_at_one_place_bound_nothing_but_the_way_on_from_the_last_of_them():
    vertex_s, limits = np.array([0.0, 1.0, 1.0, 1.0, 2.0]), np.array([np.inf, 0.1, 0.2, 0.6, np.inf])
    assert limit_between(np.array([0.0, 1.0, 2.0]), vertex_s, limits).tolist() == [np.inf, 0.6]


def test_the_profile_keeps_every_limit_and_has_slowed_down_where_its_stretch_begins():
    s, vertex_s = 0.1 * np.arange(201), np.arange(0.0, 21.0, 1.0)
    limits = np.full(21, np.inf)
    limits[10:13] = 0.4
    speed = speed_profile(s, np.zeros(201), LIMITS, limit_between(s, vertex_s, limits))
    free = speed_profile(s, np.zeros(201), LIMITS)
    assert speed[100:131] == pytest.approx(0.4)
    before = np.sqrt(0.4**2 + 2.0 * 0.6 * LIMITS.deceleration * (10.0 - s[:100]))
    assert speed[:100] == pytest.approx(np.minimum(before, free[:100]))
    after = np.sqrt(0.4**2 + 2.0 * LIMITS.acceleration * (s[131:] - 13.0))
    assert speed[131:] == pytest.approx(np.minimum(after, free[131:]))


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 3.0)), min_size=1, max_size=30), st.floats(0.01, 2.0))
def test_the_braking_bound_is_what_a_pass_backwards_finds(samples, deceleration):
    at = np.cumsum([step for step, _ in samples])
    speed = np.array([v for _, v in samples])
    expected = speed**2
    for i in reversed(range(len(at) - 1)):
        expected[i] = min(expected[i], expected[i + 1] + 2.0 * deceleration * (at[i + 1] - at[i]))
    assert braking_bound(at, speed, deceleration) ** 2 == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("wrong", [[0.5], [0.5, 0.0], [0.5, -1.0], [0.5, np.nan]])
def test_speed_limits_that_cannot_be_are_refused(wrong):
    with pytest.raises(LimitError):
        checked_limits(wrong, 2)
    assert checked_limits([], 2).tolist() == [np.inf, np.inf]


@pytest.mark.parametrize("bad", [{"speed": 0.0}, {"deceleration": -1.0}, {"turn_rate": np.inf}, {"curvature": 0.0}])
def test_refuses_impossible_limits(bad):
    with pytest.raises(LimitError):
        Limits(**bad)


def test_ackermann_needs_a_curvature():
    with pytest.raises(LimitError):
        Limits(drive=Drive.ACKERMANN)
