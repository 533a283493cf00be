import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.safety.ramp import LimitError, Ramp, RampSettings

LIMITS = RampSettings(speed=1.5, turn_rate=1.2, acceleration=1.0, deceleration=1.5, turn_acceleration=3.0)
PERIOD = 0.02
ROUNDING = 1e-9


def ramp_at(v, w):
    ramp = Ramp(LIMITS)
    for _ in range(200):
        ramp.follow(v, w, PERIOD)
    return ramp


def assert_step(before, after):
    (v0, w0), (v, w) = before, after
    assert abs(v) <= LIMITS.speed
    assert abs(w) <= LIMITS.turn_rate
    change = LIMITS.acceleration if abs(v) > abs(v0) else LIMITS.deceleration
    assert abs(v - v0) <= change * PERIOD + ROUNDING
    assert abs(w - w0) <= LIMITS.turn_acceleration * PERIOD + ROUNDING


@given(st.lists(st.tuples(st.floats(), st.floats(), st.floats()), max_size=30))
def test_whatever_comes_in_what_goes_out_is_within_the_limits(wanted):
    ramp = Ramp(LIMITS)
    for v, w, scale in wanted:
        before = ramp.command
        after = ramp.follow(v, w, PERIOD, scale)
        assert math.isfinite(after[0] + after[1])
        assert_step(before, after)


@given(st.floats(-1.5, 1.5), st.floats(-1.2, 1.2))
def test_braking_reaches_rest_in_time_on_the_same_arc(v, w):
    ramp = ramp_at(v, w)
    v, w = ramp.command
    seconds = max(abs(v) / LIMITS.deceleration, abs(w) / LIMITS.turn_acceleration)
    for _ in range(math.ceil(seconds / PERIOD) + 1):
        before = ramp.command
        after = ramp.brake(PERIOD)
        assert_step(before, after)
        assert after[0] * w == pytest.approx(after[1] * v, abs=1e-9)
    assert ramp.command == (0.0, 0.0)


@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.integers(1, 40)), max_size=8))
def test_the_jerk_of_commands_that_pass_is_bounded(wanted):
    ramp = Ramp(LIMITS)
    rates = [(0.0, 0.0)]
    for v, w, periods in wanted:
        for _ in range(periods):
            before = ramp.command
            after = ramp.follow(v, w, PERIOD)
            rates.append(tuple((b - a) / PERIOD for a, b in zip(before, after, strict=True)))
            stopped = [b == 0.0 or b == pytest.approx(goal) for b, goal in zip(after, (v, w), strict=True)]
            change = [abs(b - a) / PERIOD for a, b in zip(rates[-2], rates[-1], strict=True)]
            assert stopped[0] or change[0] <= LIMITS.braking_jerk + 1e-6
            assert stopped[1] or change[1] <= LIMITS.turn_jerk + 1e-6
            gathers = rates[-1][0] * after[0] > 0.0 and rates[-1][0] * rates[-2][0] >= 0.0
            if gathers and abs(rates[-1][0]) > abs(rates[-2][0]):
                assert change[0] <= LIMITS.jerk + 1e-6


def test_speed_is_gathered_softly_and_costs_a_tracker_s_own_profile_nothing_to_speak_of():
    ramp, asked = Ramp(RampSettings()), 0.0
    late = []
    for _ in range(150):
        asked = min(asked + 0.5 * PERIOD, 1.2)
        late.append(asked - ramp.follow(asked, 0.0, PERIOD)[0])
    assert max(late) < 0.03
    assert late[-1] == 0.0


def test_a_stop_takes_no_longer_than_without_a_limit_on_jerk():
    ramp = Ramp(RampSettings())
    for _ in range(200):
        ramp.follow(1.2, 0.0, PERIOD)
    periods = 0
    while ramp.command != (0.0, 0.0):
        ramp.brake(PERIOD)
        periods += 1
    assert periods * PERIOD <= 0.24 + PERIOD


def test_reaches_a_wanted_command_and_stays():
    assert ramp_at(0.8, -0.5).command == pytest.approx((0.8, -0.5))


def test_a_command_too_fast_becomes_a_slower_one_on_the_same_arc():
    v, w = ramp_at(3.0, 1.5).command
    assert v == pytest.approx(LIMITS.speed)
    assert w / v == pytest.approx(0.5)


def test_a_scale_bounds_the_speed_and_leaves_slower_commands_alone():
    ramp = ramp_at(1.0, 0.2)
    for _ in range(200):
        v, w = ramp.follow(1.0, 0.2, PERIOD, 0.4)
    assert (v, w) == pytest.approx((0.6, 0.12))
    for _ in range(200):
        v, w = ramp.follow(0.3, 0.2, PERIOD, 0.4)
    assert (v, w) == pytest.approx((0.3, 0.2))


def test_reversing_comes_to_rest_in_between():
    ramp = ramp_at(1.0, 0.0)
    speeds = [ramp.follow(-1.0, 0.0, PERIOD)[0] for _ in range(200)]
    assert 0.0 in speeds
    assert speeds[-1] == pytest.approx(-1.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_brakes_for_what_is_not_finite(bad):
    ramp, other = ramp_at(1.0, 0.5), ramp_at(1.0, 0.5)
    assert ramp.follow(bad, 0.0, PERIOD) == other.brake(PERIOD)
    assert ramp.follow(0.0, bad, PERIOD) == other.brake(PERIOD)


def test_an_emergency_needs_no_time():
    ramp = ramp_at(1.5, 1.0)
    assert ramp.halt() == (0.0, 0.0)
    assert ramp.command == (0.0, 0.0)


@pytest.mark.parametrize("name", ["speed", "turn_rate", "acceleration", "deceleration", "turn_acceleration"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_refuses_impossible_limits(name, bad):
    with pytest.raises(LimitError):
        RampSettings(**{name: bad})
