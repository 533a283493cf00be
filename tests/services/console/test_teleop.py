"""The page's joystick drives while it is held, and at no other time."""

import math

from hypothesis import given
from hypothesis import strategies as st

from services.console.robot.models.teleop import HELD_S, LATE_S, Teleop


def test_it_drives_within_its_limits():
    teleop = Teleop(speed=0.8, turn_rate=0.5)
    velocity = teleop.take(1, 1.0, -0.5, 0.0, 100.0)
    assert (velocity.v, velocity.w) == (0.8, -0.25)
    velocity = teleop.take(1, 7.0, -9.0, 0.05, 100.05)
    assert (velocity.v, velocity.w) == (0.8, -0.5)


def test_no_second_browser_drives_until_the_first_lets_go():
    teleop = Teleop(0.8, 0.8)
    assert teleop.take(1, 1.0, 0.0, 0.0, 100.0)
    assert teleop.take(2, -1.0, 0.0, 50.0, 100.1) is None
    assert not teleop.release(2)
    assert teleop.release(1)
    assert teleop.take(2, -1.0, 0.0, 50.0, 100.1)
    assert teleop.held(100.1 + HELD_S + 0.01) is None
    assert teleop.take(1, 1.0, 0.0, 1.0, 101.0)


def test_commands_that_come_late_move_nothing():
    teleop = Teleop(0.8, 0.8)
    assert teleop.take(1, 1.0, 0.0, 10.0, 100.0)
    late = LATE_S + 0.1
    assert teleop.take(1, 1.0, 0.0, 10.1, 100.1 + late) is None
    assert teleop.take(1, 1.0, 0.0, 10.0 + late + 0.1, 100.0 + late + 0.1)


@given(st.lists(st.floats(allow_nan=True), min_size=3, max_size=3))
def test_nonsense_moves_nothing(values):
    velocity = Teleop(0.8, 0.8).take(1, *values, now=100.0)
    if all(map(math.isfinite, values)):
        assert abs(velocity.v) <= 0.8
        assert abs(velocity.w) <= 0.8
    else:
        assert velocity is None
