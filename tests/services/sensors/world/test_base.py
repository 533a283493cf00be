from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.sensors.world import Base, BaseSettings, BaseState

STEP = 0.01
SURE_FOOTED = BaseSettings(slip=0.0, turn_slip=0.0, curve_slip=0.0, odometry_noise=(0.0, 0.0))


def drive(base, seconds, command=None, start=0.0):
    now = start
    for _ in range(round(seconds / STEP)):
        if command is not None:
            base.command(*command, now)
        now += STEP
        base.step(STEP, now)
    return now


def test_reaches_the_commanded_speed_within_its_acceleration():
    base = Base(SURE_FOOTED, 0)
    speeds = [0.0]
    now = 0.0
    for _ in range(200):
        base.command(1.0, 0.3, now)
        now += STEP
        base.step(STEP, now)
        speeds.append(base.state.wheel_v)
    assert base.state.twist == pytest.approx((1.0, 0.3), abs=1e-3)
    assert np.diff(speeds).max() <= SURE_FOOTED.acceleration * STEP + 1e-12


def test_a_command_waits_for_the_delay():
    base = Base(SURE_FOOTED, 0)
    base.command(1.0, 0.0, 0.0)
    base.step(STEP, SURE_FOOTED.delay - 0.001)
    assert base.state.wheel_v == 0.0
    base.step(STEP, SURE_FOOTED.delay + 0.001)
    assert base.state.wheel_v > 0.0


def test_stops_by_itself_when_commands_end():
    base = Base(BaseSettings(), 0)
    now = drive(base, 3.0, (1.5, 0.2))
    last = now - STEP
    positions = [base.pose()]
    while now < last + 0.3 - STEP / 2:
        now = drive(base, STEP, start=now)
        positions.append(base.pose())
    assert base.state.wheel_v > 1.3
    before = base.pose()
    now = drive(base, 0.3, start=now)
    assert base.state.wheel_v == pytest.approx(0.0, abs=1e-9)
    assert base.state.wheel_w == pytest.approx(0.0, abs=1e-9)
    # v^2 / 2a of 1.5 m/s at 6 m/s^2 is 0.19 m.
    assert np.hypot(*(base.pose() - before)[:2]) < 0.23
    stood = base.pose()
    drive(base, 1.0, start=now)
    assert base.pose() == pytest.approx(stood)


def test_a_command_under_way_does_not_restart_a_base_that_timed_out():
    base = Base(BaseSettings(delay=0.5), 0)
    base.command(1.0, 0.0, 0.0)
    for now in np.arange(STEP, 2.0, STEP):
        base.step(STEP, float(now))
    assert base.state.wheel_v == 0.0


def test_without_slip_a_circle_closes():
    base = Base(SURE_FOOTED, 0, BaseState(wheel_v=1.0, wheel_w=0.5))
    base.command(1.0, 0.5, -1.0)
    drive(base, 2 * np.pi / 0.5, (1.0, 0.5))
    assert base.pose()[:2] == pytest.approx([0.0, 0.0], abs=0.03)


def test_slip_lets_wheels_and_ground_disagree_and_more_so_in_curves():
    def loss(command):
        base = Base(BaseSettings(odometry_noise=(0.0, 0.0)), 5)
        drive(base, 20.0, command)
        return abs(base.state.slip_v), base.wheel_odometry(), base.state.twist

    slip, wheels, truth = loss((1.0, 0.8))
    assert wheels[1] > truth[1]
    assert wheels[0] != truth[0]
    runs = {w: [] for w in (0.0, 1.5)}
    for w, turned in runs.items():
        for seed in range(24):
            base = Base(BaseSettings(), seed)
            drive(base, 2.0, (1.5, w))
            turned.append(base.state.slip_v)
    assert np.std(runs[1.5]) > 1.2 * np.std(runs[0.0])
    assert slip < 0.5


def test_a_restored_base_goes_on_where_it_stood():
    base = Base(BaseSettings(), 0)
    drive(base, 2.0, (1.0, 0.4))
    stored = base.state.to_dict()
    again = Base(BaseSettings(), 0, BaseState.from_dict(stored))
    assert again.state == base.state
    drive(again, 1.0)
    assert again.state.wheel_v == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(again.state.x - base.state.x, again.state.y - base.state.y) < 0.15


@pytest.mark.parametrize(
    "stored", [{}, {"x": 1.0}, {**BaseState().to_dict(), "x": float("nan")}, {**BaseState().to_dict(), "z": 0.0}]
)
def test_a_damaged_state_is_refused(stored):
    with pytest.raises(ValueError, match="state of a base"):
        BaseState.from_dict(stored)


def test_a_command_that_is_not_finite_is_refused_and_changes_nothing():
    base = Base(BaseSettings(), 0)
    with pytest.raises(ValueError, match="finite"):
        base.command(float("nan"), 0.0, 0.0)
    assert base.timed_out(0.0)


@settings(max_examples=25)
@given(v=st.floats(-100, 100), w=st.floats(-100, 100))
def test_no_command_exceeds_the_limits(v, w):
    limits = BaseSettings()
    base = Base(limits, 0)
    drive(base, 1.5, (v, w))
    assert abs(base.state.wheel_v) <= limits.speed_limit + 1e-9
    assert abs(base.state.wheel_w) <= limits.turn_limit + 1e-9
