import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.tracker.limits import Drive, Limits
from services.tracker.mpc import MpcSettings, PathMpc, Reference, State
from services.tracker.ramp import brake

LIMITS = {
    "unicycle": Limits(speed=1.2, turn_rate=0.8, acceleration=0.5, deceleration=0.6, turn_acceleration=1.5),
    "ackermann": Limits(drive=Drive.ACKERMANN, speed=1.2, turn_rate=0.8, curvature=0.4),
}
CONTROLLERS = {name: PathMpc(limits) for name, limits in LIMITS.items()}
ROUNDING = 1e-9


def along(speed, curvature, horizon=20, step=0.1):
    s = np.linspace(0.0, speed * step * horizon, horizon + 1)
    return Reference(s, np.full(horizon + 1, speed), np.full(horizon + 1, curvature))


def assert_within(limits, before, after, seconds):
    (v0, w0), (v, w) = before, after
    assert abs(v) <= limits.speed + ROUNDING
    assert abs(w) <= limits.turn_rate + ROUNDING
    assert -limits.deceleration * seconds - ROUNDING <= v - v0 <= limits.acceleration * seconds + ROUNDING
    assert abs(w - w0) <= limits.turn_acceleration * seconds + ROUNDING
    if limits.curvature is not None:
        assert abs(w) <= limits.curvature * abs(v) + ROUNDING


finite = st.floats(-50.0, 50.0)


@settings(max_examples=150)
@given(
    st.sampled_from(sorted(LIMITS)),
    st.tuples(finite, finite, st.floats(-math.pi, math.pi), finite, finite),
    st.floats(0.0, 1.0),
    st.floats(-1.0, 1.0),
    st.floats(0.0, 1.2),
    st.floats(-1.0, 1.0),
)
def test_every_command_is_within_every_limit(kind, beside, v_share, w_share, speed, curvature):
    limits = LIMITS[kind]
    v0 = v_share * limits.speed
    w0 = w_share * (limits.turn_rate if limits.curvature is None else min(limits.turn_rate, limits.curvature * v0))
    command = CONTROLLERS[kind].solve(State(*beside, v0, w0), along(speed, curvature), 0.05)
    assert math.isfinite(command.v)
    assert math.isfinite(command.w)
    assert_within(limits, (v0, w0), (command.v, command.w), 0.05)


@pytest.mark.parametrize("kind", sorted(LIMITS))
def test_on_the_path_at_the_right_speed_nothing_changes(kind):
    command = CONTROLLERS[kind].solve(State(0.0, 0.0, 0.0, 1.0, 0.2, 1.0, 0.2), along(1.0, 0.2), 0.05)
    assert not command.problem
    assert (command.v, command.w) == pytest.approx((1.0, 0.2), abs=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_left_of_the_path_it_turns_right_and_right_of_it_left(side):
    command = CONTROLLERS["unicycle"].solve(State(0.0, 0.3 * side, 0.0, 1.0, 0.0, 1.0, 0.0), along(1.0, 0.0), 0.05)
    assert command.w * side < -0.05


def test_where_it_is_on_the_route_does_not_matter():
    state = (0.2, -0.1, 1.0, 0.1, 1.0, 0.1)
    near = along(1.0, 0.2)
    far = Reference(near.s + 4000.0, near.v, near.curvature)
    one = CONTROLLERS["unicycle"].solve(State(0.0, *state), near, 0.05)
    other = CONTROLLERS["unicycle"].solve(State(4000.0, *state), far, 0.05)
    assert (one.v, one.w) == pytest.approx((other.v, other.w), abs=1e-6)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_stops_with_a_reason_for_what_is_not_finite(bad):
    controller, limits = CONTROLLERS["unicycle"], LIMITS["unicycle"]
    command = controller.solve(State(0.0, bad, 0.0, 1.0, 0.4, 1.0, 0.4), along(1.0, 0.0), 0.05)
    assert "finite" in command.problem
    assert (command.v, command.w) == pytest.approx(brake(1.0, 0.4, 0.05, limits))


def test_stops_with_a_reason_where_the_solver_gives_up():
    controller = PathMpc(LIMITS["unicycle"])
    controller._solver.settings.max_iter = 1
    command = controller.solve(State(0.0, 0.9, 0.5, 0.0, 0.0, 1.0, 0.4), along(1.0, 0.5), 0.05)
    assert "PIQP_MAX_ITER_REACHED" in command.problem
    assert 0.0 < command.v < 1.0
    assert command.w / command.v == pytest.approx(0.4)


def test_a_command_beyond_the_limits_is_brought_within_them():
    command = CONTROLLERS["unicycle"].solve(State(0.0, 0.0, 0.0, 3.0, 0.0, 3.0, -5.0), along(1.0, 0.0), 0.05)
    assert 0.0 <= command.v <= LIMITS["unicycle"].speed
    assert abs(command.w) <= LIMITS["unicycle"].turn_rate


def test_the_model_holds_over_the_horizon():
    """The predicted states are those of the vehicle: integrated finely, the planned commands lead there."""
    mpc = MpcSettings()
    controller = PathMpc(LIMITS["unicycle"], mpc)
    reference = along(1.0, 0.25)
    controller.solve(State(0.0, 0.1, 0.05, 1.0, 0.25, 1.0, 0.25), reference, 0.05)
    plan = controller._solver.result.x.reshape(mpc.horizon, 9)
    s, e, psi, v, w, vc, wc, dt = 0.0, 0.1, 0.05, 1.0, 0.25, 1.0, 0.25, 0.001
    for k in range(mpc.horizon):
        for _ in range(100):
            vc, wc = vc + plan[k, 7] * dt, wc + plan[k, 8] * dt
            v, w = v + (vc - v) * dt / mpc.lag, w + (wc - w) * dt / mpc.lag
            rate = v * math.cos(psi) / (1.0 - 0.25 * e)
            s, e, psi = s + rate * dt, e + v * math.sin(psi) * dt, psi + (w - 0.25 * rate) * dt
        assert plan[k, :5] == pytest.approx([s, e, psi, v, w], abs=0.02)
