"""From one command to the next: no limit is exceeded, whatever is wanted."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.tracker.limits import Limits
from services.tracker.ramp import approach, brake, within
from tests.services.tracker.vehicles import all_limits, assert_possible

number = st.floats(-10.0, 10.0)
anything = st.floats(allow_nan=True, allow_infinity=True)


@given(all_limits(), number, number, anything, anything, st.floats(0.001, 0.2))
def test_every_step_towards_a_command_is_possible_whatever_is_wanted(limits, v0, w0, v, w, seconds):
    now = within(v0, w0, limits)
    assert_possible(limits, now, approach(now, (v, w), seconds, limits), seconds)


@given(all_limits(), number, number, number, number)
def test_it_arrives_at_what_is_possible(limits, v0, w0, v, w):
    now, wanted = within(v0, w0, limits), within(v, w, limits)
    for _ in range(100_000):
        then = approach(now, wanted, 0.2, limits)
        if then == now:
            break
        now = then
    assert now == pytest.approx(wanted)


@given(all_limits(), number, number)
def test_braking_keeps_the_arc_and_the_limits_and_comes_to_rest(limits, v, w):
    v, w = within(v, w, limits)
    bound = max(abs(v) / limits.deceleration, abs(w) / limits.turn_acceleration)
    for _ in range(math.ceil(bound / 0.05) + 1):
        v_next, w_next = brake(v, w, 0.05, limits)
        assert_possible(limits, (v, w), (v_next, w_next), 0.05)
        assert v * w_next == pytest.approx(w * v_next, abs=1e-9)
        v, w = v_next, w_next
    assert (v, w) == (0.0, 0.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_rest_is_wanted_where_the_wanted_command_is_no_number(bad):
    assert approach((1.0, 0.2), (bad, 0.1), 0.1, Limits()) == approach((1.0, 0.2), (0.0, 0.0), 0.1, Limits())
    assert within(bad, 0.0, Limits()) == within(0.0, bad, Limits()) == (0.0, 0.0)
