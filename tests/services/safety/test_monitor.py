import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.safety.inputs import MOTION_OF_STATE, CommandKind, SafetyInputs, VelocityCommand
from services.safety.monitor import SafetyMonitor, SafetySettings
from services.safety.rules import Cause

PERIOD = SafetySettings().period
DECELERATION = SafetySettings().ramp.deceleration
WELL = SafetyInputs(
    state="repeat.follow",
    state_age=0.1,
    command=VelocityCommand(1.0, 0.2, CommandKind.DESIRED, 0.03),
    odometry_age=0.05,
    localization_age=0.1,
    metres_since_success=0.1,
    seconds_since_success=0.1,
    path_offset=0.02,
    covariance=1e-4 * np.eye(6),
)


class Loop:
    """A monitor with a clock that goes on by a period at every step."""

    def __init__(self):
        self.monitor, self.now = SafetyMonitor(), 100.0

    def run(self, inputs, seconds):
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            output = self.monitor.step(self.now, inputs)
        return output


@pytest.fixture
def driving():
    loop = Loop()
    output = loop.run(WELL, 3.0)
    assert (output.v, output.w) == pytest.approx((1.0, 0.2))
    assert output.reasons == ()
    return loop


def test_a_lost_command_ramps_the_robot_down_on_its_arc(driving):
    lost = replace(WELL, command=replace(WELL.command, age=0.3))
    output = driving.run(lost, PERIOD)
    assert output.v == pytest.approx(1.0 - DECELERATION * PERIOD)
    assert output.w / output.v == pytest.approx(0.2)
    output = driving.run(lost, 1.0 / DECELERATION)
    assert (output.v, output.w) == (0.0, 0.0)
    assert [reason.cause for reason in output.reasons] == [Cause.COMMAND_STALE]


def test_it_goes_on_by_itself_when_the_command_is_back(driving):
    driving.run(replace(WELL, command=None), 2.0)
    assert driving.run(WELL, 2.0).v == pytest.approx(1.0)


def test_an_emergency_stops_at_once(driving):
    output = driving.run(replace(WELL, estop="The button."), PERIOD)
    assert (output.v, output.w) == (0.0, 0.0)


def test_a_reset_starts_no_motion_however_long_the_commands_go_on(driving):
    driving.run(replace(WELL, estop="The button."), 1.0)
    output = driving.run(WELL, 5.0)
    assert (output.v, output.w) == (0.0, 0.0)
    assert [reason.cause for reason in output.reasons] == [Cause.REARMING]


@pytest.mark.parametrize(
    "neutral",
    [
        replace(WELL, command=None),
        replace(WELL, state="paused"),
        replace(WELL, command=replace(WELL.command, v=0.0, w=0.0)),
        replace(WELL, command=replace(WELL.command, age=0.3)),
    ],
    ids=["no command", "paused", "command to stand", "old command"],
)
def test_after_a_reset_and_a_moment_without_a_command_a_fresh_one_moves_the_robot(driving, neutral):
    driving.run(replace(WELL, estop="The button."), 1.0)
    driving.run(neutral, PERIOD)
    assert driving.run(replace(WELL, command=replace(WELL.command, age=0.2)), PERIOD).v == 0.0
    assert driving.run(WELL, 3.0).v == pytest.approx(1.0)


def test_a_moment_without_a_command_before_the_reset_does_not_count(driving):
    driving.run(replace(WELL, estop="The button.", command=None), 1.0)
    assert driving.run(WELL, 1.0).v == 0.0


def test_slower_and_then_stopped_while_it_is_not_localized(driving):
    output = driving.run(replace(WELL, metres_since_success=8.0), 2.0)
    assert output.v == pytest.approx(output.scale * SafetySettings().ramp.speed)
    assert 0.0 < output.v < 1.0
    assert driving.run(replace(WELL, metres_since_success=11.0), 2.0).v == 0.0


def test_a_loop_that_hung_makes_no_jump_in_speed():
    monitor = SafetyMonitor()
    monitor.step(0.0, WELL)
    before = monitor.step(0.02, WELL).v
    after = monitor.step(5.0, WELL).v
    assert after - before <= 2.0 * PERIOD * SafetySettings().ramp.acceleration + 1e-9


def test_a_clock_that_goes_backwards_changes_nothing():
    monitor = SafetyMonitor()
    before = monitor.step(10.0, WELL).v
    assert monitor.step(9.0, WELL).v == before


def test_before_anything_is_known_the_robot_stands():
    output = SafetyMonitor().step(0.0, SafetyInputs())
    assert (output.v, output.w) == (0.0, 0.0)
    assert output.reasons


def test_after_a_hang_in_which_the_base_has_stopped_by_itself_the_robot_starts_from_rest(driving):
    driving.now += 0.5
    output = driving.run(WELL, PERIOD)
    assert 0.0 < output.v <= 2.0 * PERIOD * SafetySettings().ramp.acceleration
    driving.run(WELL, 3.0)
    driving.now += 0.5
    output = driving.run(replace(WELL, command=None), PERIOD)
    assert (output.v, output.w) == (0.0, 0.0)


NOT_AN_AGE = st.one_of(st.none(), st.just(math.nan), st.floats(min_value=0.51))
NOT_A_SPEED = st.one_of(st.sampled_from([math.nan, math.inf, -math.inf]), st.floats(5.01), st.floats(max_value=-5.01))
NOT_A_TURN_RATE = st.one_of(st.just(math.nan), st.floats(10.01), st.floats(max_value=-10.01))
NOT_A_DISTANCE = st.one_of(st.none(), st.just(math.nan), st.floats(10.01))
COMMANDS = st.one_of(
    st.builds(VelocityCommand, NOT_A_SPEED, st.floats(-1, 1), st.just(CommandKind.DESIRED), st.just(0.0)),
    st.builds(VelocityCommand, st.floats(-1, 1), NOT_A_TURN_RATE, st.just(CommandKind.DESIRED), st.just(0.0)),
    st.builds(VelocityCommand, st.floats(), st.floats(), st.just(CommandKind.TELEOP), st.floats()),
    st.builds(VelocityCommand, st.floats(), st.floats(), st.sampled_from(CommandKind), st.floats(0.251)),
    st.none(),
)
FAULTS = st.one_of(
    st.builds(lambda command: {"command": command}, COMMANDS),
    st.dictionaries(
        st.sampled_from(["state_age", "odometry_age", "localization_age"]), NOT_AN_AGE, min_size=1, max_size=1
    ),
    st.dictionaries(
        st.sampled_from(["metres_since_success", "seconds_since_success"]), NOT_A_DISTANCE, min_size=1, max_size=1
    ),
    st.builds(
        lambda offset: {"path_offset": offset},
        st.one_of(st.none(), st.just(math.nan), st.floats(0.81), st.floats(max_value=-0.81)),
    ),
    st.builds(
        lambda variance: {"covariance": np.diag([variance] * 6)},
        st.one_of(st.sampled_from([math.nan, math.inf]), st.floats(0.26), st.floats(max_value=-1e-6)),
    ),
    st.builds(lambda name: {"state": name}, st.text().filter(lambda name: name not in MOTION_OF_STATE)),
)


@given(st.lists(FAULTS, min_size=1, max_size=4))
def test_what_is_no_number_or_huge_or_old_or_of_the_wrong_kind_only_ever_brakes(faults):
    loop, silent = Loop(), Loop()
    for each in (loop, silent):
        each.run(WELL, 1.0)
    for fault in faults:
        output, silence = loop.run(replace(WELL, **fault), PERIOD), silent.run(SafetyInputs(), PERIOD)
        assert (output.v, output.w) == (silence.v, silence.w)
        assert output.reasons


@given(st.lists(FAULTS, min_size=1, max_size=50))
def test_a_robot_that_only_ever_hears_nonsense_never_moves(faults):
    loop = Loop()
    for fault in faults:
        output = loop.run(replace(WELL, **fault), PERIOD)
        assert (output.v, output.w) == (0.0, 0.0)
