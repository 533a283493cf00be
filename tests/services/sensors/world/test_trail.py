"""Where the base was, between the moments at which it was stepped."""

from __future__ import annotations

import numpy as np
import pytest

from services.sensors.world import Base, BaseSettings, BaseState
from services.sensors.world.trail import Trail

SURE_FOOTED = BaseSettings(slip=0.0, turn_slip=0.0, curve_slip=0.0)


def driven(command, seconds, step=0.02):
    """A trail of a base that was told one command, and the base itself."""
    base, now = Base(SURE_FOOTED, 0), 0.0
    trail = Trail(now, base.state)
    for _ in range(round(seconds / step)):
        base.command(*command, now)
        now += step
        base.step(step, now)
        trail.add(now, base.state)
    return trail, base, now


def test_between_two_steps_it_is_on_the_arc():
    """A circle of 2 m, sampled every 20 ms at 1 m/s."""
    clock = np.arange(0.0, 0.5, 0.02)
    trail = Trail(0.0, BaseState())
    for now in clock[1:]:
        trail.add(now, BaseState(2.0 * np.sin(now / 2.0), 2.0 - 2.0 * np.cos(now / 2.0), now / 2.0))
    times = np.arange(0.0, clock[-1], 0.003)
    circle = np.stack([2.0 * np.sin(times / 2.0), 2.0 - 2.0 * np.cos(times / 2.0), times / 2.0], axis=-1)
    assert trail.poses(times) == pytest.approx(circle, abs=5e-5)


def test_a_heading_goes_on_through_the_back():
    trail = Trail(0.0, BaseState(yaw=np.pi - 0.05))
    trail.add(0.1, BaseState(yaw=-np.pi + 0.05))
    assert trail.poses([0.05])[0, 2] == pytest.approx(np.pi)
    assert trail.poses([0.1])[0, 2] == pytest.approx(np.pi + 0.05)


def test_it_stands_before_its_beginning_and_goes_on_after_its_end():
    trail, base, now = driven((1.0, 0.8), 2.0)
    ahead = trail.poses([now + 0.02])[0]
    base.command(1.0, 0.8, now)
    base.step(0.02, now + 0.02)
    assert ahead == pytest.approx(base.pose(), abs=2e-4)
    start = Trail(5.0, BaseState(1.0, 2.0, 0.3))
    assert start.poses([0.0, 5.0]) == pytest.approx(np.array([[1.0, 2.0, 0.3]] * 2))


def test_what_is_long_ago_is_forgotten():
    trail, _, _ = driven((1.0, 0.0), 10.0)
    assert len(trail._rows) < 60
