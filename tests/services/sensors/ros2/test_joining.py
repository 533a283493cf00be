"""Pairs, rates, and when the base is commanded."""

from hypothesis import given
from hypothesis import strategies as st

from services.sensors.ros2.command import CommandGate
from services.sensors.ros2.pace import Pace
from services.sensors.ros2.pairs import Joiner, Pair

MS = 1_000_000


def test_images_of_one_stamp_are_joined_in_either_order():
    joiner = Joiner(5 * MS)
    assert joiner.add("left", 100, "l1") is None
    assert joiner.add("right", 100, "r1") == Pair(100, "l1", "r1")
    assert joiner.add("right", 200 * MS, "r2") is None
    assert joiner.add("left", 200 * MS, "l2") == Pair(200 * MS, "l2", "r2")
    assert joiner.unmatched == 0


def test_the_exact_stamp_is_preferred_to_a_near_one():
    joiner = Joiner(5 * MS)
    joiner.add("left", 98 * MS, "near")
    joiner.add("left", 100 * MS, "exact")
    assert joiner.add("right", 100 * MS, "r").left == "exact"
    assert joiner.unmatched == 1


def test_stamps_further_apart_than_the_tolerance_are_of_no_pair():
    joiner = Joiner(5 * MS)
    joiner.add("left", 0, "l")
    assert joiner.add("right", 6 * MS, "r") is None
    assert joiner.add("left", 10 * MS, "l2") == Pair(10 * MS, "l2", "r")
    assert joiner.unmatched == 1


def test_a_camera_alone_fills_no_memory():
    joiner = Joiner(0)
    for stamp in range(1000):
        assert joiner.add("left", stamp, stamp) is None
    assert joiner.unmatched == 1000 - 8


@given(st.lists(st.tuples(st.sampled_from(["left", "right"]), st.integers(0, 40)), max_size=60), st.integers(0, 3))
def test_whatever_comes_only_near_stamps_are_joined_and_each_once(arrivals, tolerance):
    joiner, used = Joiner(tolerance), set()
    for number, (side, stamp) in enumerate(arrivals):
        pair = joiner.add(side, stamp, (number, side, stamp))
        if pair is not None:
            assert (pair.left[1], pair.right[1], pair.left[2]) == ("left", "right", pair.stamp_ns)
            assert abs(pair.left[2] - pair.right[2]) <= tolerance
            assert not used & {pair.left, pair.right}
            used |= {pair.left, pair.right}


def test_a_sensor_of_the_rate_itself_loses_nothing_to_jitter():
    pace = Pace(10.0)
    assert all(pace.lets(0.1 * n + 0.02 * (-1) ** n) for n in range(100))


def test_a_faster_sensor_is_kept_down_to_the_rate():
    pace = Pace(10.0)
    passed = sum(pace.lets(n / 30.0) for n in range(301))
    assert 99 <= passed <= 102


def test_a_command_passes_while_it_is_fresh():
    gate = CommandGate(0.3)
    assert gate.fresh(1.0, 1.0)
    assert gate.fresh(1.1, 1.39)
    assert not gate.fresh(1.2, 1.51)


def test_when_commands_fall_silent_the_base_is_told_to_stop_for_a_second_and_then_left_alone():
    gate = CommandGate(0.3)
    assert not gate.stops(0.5)
    gate.fresh(1.0, 1.0)
    times = [1.0 + 0.02 * n for n in range(200)]
    stops = [now for now in times if gate.stops(now)]
    assert 1.29 < stops[0] <= 1.33
    assert 2.2 < stops[-1] <= 2.31
    assert 12 <= len(stops) <= 21
    assert gate.fresh(6.0, 6.0)
    assert gate.stops(6.4)


def test_an_old_command_starts_nothing():
    gate = CommandGate(0.3)
    assert not gate.fresh(1.0, 2.0)
    assert not gate.stops(2.0)
