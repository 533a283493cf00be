import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import Zone
from services.safety.inputs import MOTION_OF_STATE, CommandKind, SafetyInputs, VelocityCommand
from services.safety.limits import RuleSettings
from services.safety.rules import RULES, Cause, Effect, evaluate

SETTINGS = RuleSettings(dead_mans_switch=True)
FOLLOWING = SafetyInputs(
    state="repeat.follow",
    state_age=0.1,
    command=VelocityCommand(1.0, 0.1, CommandKind.DESIRED, 0.05),
    odometry_age=0.05,
    localization_age=0.1,
    switch_held=True,
    switch_age=0.1,
    metres_since_success=0.1,
    seconds_since_success=0.1,
    path_offset=0.02,
    covariance=1e-4 * np.eye(6),
)
TEACHING = SafetyInputs(
    state="teach.branch",
    state_age=0.1,
    command=VelocityCommand(0.5, 0.1, CommandKind.TELEOP, 0.05),
    switch_held=True,
    switch_age=0.1,
)


def command(**changes):
    return {"command": replace(FOLLOWING.command, **changes)}


def causes(inputs, settings=SETTINGS):
    return {reason.cause for reason in evaluate(inputs, settings).reasons}


@pytest.mark.parametrize("inputs", [FOLLOWING, TEACHING], ids=["repeat", "teach"])
def test_nothing_stands_in_the_way_when_all_is_well(inputs):
    verdict = evaluate(inputs, SETTINGS)
    assert verdict.reasons == ()
    assert verdict.scale == 1.0
    assert verdict.effect is None


OBJECTIONS = [
    ({"estop": "pressed by the operator"}, Cause.EMERGENCY_STOP),
    ({"rearming": True}, Cause.REARMING),
    ({"state": None}, Cause.STATE_UNKNOWN),
    ({"state_age": None}, Cause.STATE_UNKNOWN),
    ({"state_age": 0.51}, Cause.STATE_UNKNOWN),
    ({"state": "idle"}, Cause.STATE_FORBIDS),
    ({"state": "paused"}, Cause.STATE_FORBIDS),
    ({"state": "repeat.plan"}, Cause.STATE_FORBIDS),
    ({"state": "repeat.metric_localize"}, Cause.STATE_FORBIDS),
    ({"state": "made.up"}, Cause.STATE_FORBIDS),
    ({"command": None}, Cause.COMMAND_STALE),
    (command(age=0.251), Cause.COMMAND_STALE),
    (command(age=math.nan), Cause.COMMAND_STALE),
    (command(kind=CommandKind.TELEOP), Cause.COMMAND_KIND),
    ({"state": "teach.branch"}, Cause.COMMAND_KIND),
    (command(v=math.nan), Cause.COMMAND_INVALID),
    (command(w=math.inf), Cause.COMMAND_INVALID),
    (command(v=5.1), Cause.COMMAND_INVALID),
    (command(w=-1e300), Cause.COMMAND_INVALID),
    ({"missing": ("estimator",)}, Cause.SERVICE_MISSING),
    ({"switch_held": False}, Cause.DEAD_MANS_SWITCH),
    ({"switch_age": 0.301}, Cause.DEAD_MANS_SWITCH),
    ({"switch_age": None}, Cause.DEAD_MANS_SWITCH),
    ({"odometry_age": 0.501}, Cause.ODOMETRY_STALE),
    ({"odometry_age": None}, Cause.ODOMETRY_STALE),
    ({"localization_age": 0.501}, Cause.LOCALIZATION_STALE),
    ({"localization_age": math.nan}, Cause.LOCALIZATION_STALE),
    ({"metres_since_success": 10.01}, Cause.METRES_UNLOCALIZED),
    ({"metres_since_success": None}, Cause.METRES_UNLOCALIZED),
    ({"metres_since_success": math.nan}, Cause.METRES_UNLOCALIZED),
    ({"seconds_since_success": 10.01}, Cause.SECONDS_UNLOCALIZED),
    ({"seconds_since_success": None}, Cause.SECONDS_UNLOCALIZED),
    ({"obstacles": Zone.STOP, "obstacles_age": 0.1}, Cause.OBSTACLE),
    ({"obstacles": Zone.CLEAR, "obstacles_age": 0.51}, Cause.OBSTACLES_STALE),
    ({"obstacles": Zone.CLEAR}, Cause.OBSTACLES_STALE),
    ({"path_offset": -0.81}, Cause.PATH_OFFSET),
    ({"path_offset": math.nan}, Cause.PATH_OFFSET),
    ({"path_offset": None}, Cause.PATH_OFFSET),
    ({"covariance": 0.26 * np.eye(6)}, Cause.UNCERTAIN),
    ({"covariance": np.diag([0.0, 0, 0, 0, 0, 0.2])}, Cause.UNCERTAIN),
    ({"covariance": np.full((6, 6), np.nan)}, Cause.UNCERTAIN),
    ({"covariance": None}, Cause.UNCERTAIN),
    ({"covariance": -1e-4 * np.eye(6)}, Cause.UNCERTAIN),
    ({"covariance": np.diag([1e-4, 1e-4, 0, 0, 0, -1.0])}, Cause.UNCERTAIN),
]


@pytest.mark.parametrize(("change", "cause"), OBJECTIONS)
def test_each_single_fault_stops_the_robot_for_its_own_reason(change, cause):
    verdict = evaluate(replace(FOLLOWING, **change), SETTINGS)
    assert {reason.cause for reason in verdict.reasons} == {cause}
    assert verdict.scale == 0.0
    assert verdict.effect is (Effect.EMERGENCY if cause is Cause.EMERGENCY_STOP else Effect.STOP)


BY_BEARING = replace(FOLLOWING, metric=False, path_offset=0.0, covariance=np.diag([0.3, 1.0, 1, 1, 1, 0.05]) ** 2)


def test_where_the_lateral_offset_is_not_measured_only_distance_and_heading_are_judged():
    assert evaluate(BY_BEARING, SETTINGS).reasons == ()
    assert evaluate(replace(BY_BEARING, path_offset=5.0), SETTINGS).reasons == ()
    assert causes(replace(BY_BEARING, metric=True)) == {Cause.UNCERTAIN}


@pytest.mark.parametrize(("sigmas", "what"), [((1.3, 0.05), "distance"), ((0.3, 0.4), "heading")])
def test_distance_and_heading_of_a_bearing_map_have_their_limits(sigmas, what):
    uncertain = replace(BY_BEARING, covariance=np.diag([sigmas[0], 1.0, 1, 1, 1, sigmas[1]]) ** 2)
    (reason,) = evaluate(uncertain, SETTINGS).reasons
    assert reason.cause is Cause.UNCERTAIN
    assert what in reason.sentence


def test_what_a_bearing_map_measures_must_still_be_known():
    assert causes(replace(BY_BEARING, covariance=None)) == {Cause.UNCERTAIN}
    assert causes(replace(BY_BEARING, localization_age=0.6)) == {Cause.LOCALIZATION_STALE}
    assert causes(replace(BY_BEARING, metres_since_success=10.1)) == {Cause.METRES_UNLOCALIZED}


def test_every_cause_of_the_table_was_provoked():
    assert {rule.cause for rule in RULES} == {cause for _, cause in OBJECTIONS} == set(Cause)


BOUNDARIES = [
    command(age=0.25),
    {"switch_age": 0.3},
    {"odometry_age": 0.5},
    {"localization_age": 0.5},
    {"path_offset": -0.8},
    {"state_age": 0.5},
]


@pytest.mark.parametrize("change", BOUNDARIES)
def test_at_its_limit_a_value_still_passes(change):
    assert causes(replace(FOLLOWING, **change)) == set()


def test_teaching_needs_no_localization_and_takes_the_operator_alone():
    assert MOTION_OF_STATE["teach.branch"] is CommandKind.TELEOP
    lost = replace(TEACHING, odometry_age=9.0, localization_age=None, path_offset=5.0)
    assert causes(lost) == set()
    assert causes(replace(TEACHING, command=FOLLOWING.command)) == {Cause.COMMAND_KIND}


def test_a_switch_that_is_not_configured_is_not_asked_for():
    assert causes(replace(FOLLOWING, switch_held=False, switch_age=None), RuleSettings()) == set()


@pytest.mark.parametrize("what", ["metres_since_success", "seconds_since_success"])
def test_first_slower_then_stop(what):
    verdicts = [evaluate(replace(FOLLOWING, **{what: value}), SETTINGS) for value in (3.0, 4.0, 7.0, 10.0, 10.1)]
    scales = [verdict.scale for verdict in verdicts]
    assert scales == sorted(scales, reverse=True)
    assert scales[0] == 1.0
    assert scales[3] == pytest.approx(SETTINGS.slowest)
    assert scales[4] == 0.0
    assert [verdict.effect for verdict in verdicts] == [None, Effect.SLOW, Effect.SLOW, Effect.SLOW, Effect.STOP]


def test_something_near_slows_the_robot_down():
    verdict = evaluate(replace(FOLLOWING, obstacles=Zone.SLOW, obstacles_age=0.1), SETTINGS)
    assert [(reason.cause, reason.effect) for reason in verdict.reasons] == [(Cause.OBSTACLE, Effect.SLOW)]
    assert verdict.scale == SETTINGS.obstacle_slow
    far = replace(FOLLOWING, obstacles=Zone.SLOW, obstacles_age=0.1, metres_since_success=9.9)
    assert evaluate(far, SETTINGS).scale < SETTINGS.obstacle_slow
    assert evaluate(replace(FOLLOWING, obstacles=Zone.CLEAR, obstacles_age=0.1), SETTINGS).reasons == ()


def test_all_reasons_are_listed_and_each_says_the_value_and_its_limit():
    verdict = evaluate(replace(FOLLOWING, odometry_age=0.8, path_offset=1.2, **command(age=0.4)), SETTINGS)
    sentences = [reason.sentence for reason in verdict.reasons]
    assert sentences == [
        "The last command is 0.40 s old; the limit is 0.25 s.",
        "The last odometry is 0.80 s old; the limit is 0.50 s.",
        "The robot is 1.20 m off the path; the limit is 0.80 m.",
    ]


anything = st.one_of(st.none(), st.floats())
commands = st.builds(VelocityCommand, st.floats(), st.floats(), st.sampled_from(CommandKind), st.floats())
inputs = st.builds(
    SafetyInputs,
    state=st.one_of(st.none(), st.text(), st.sampled_from(sorted(MOTION_OF_STATE))),
    command=st.one_of(st.none(), commands),
    covariance=st.one_of(st.none(), st.floats().map(lambda value: np.full((6, 6), value))),
    estop=st.one_of(st.none(), st.text()),
    missing=st.lists(st.text()).map(tuple),
    switch_held=st.booleans(),
    rearming=st.booleans(),
    **{
        field.name: anything
        for field in fields(SafetyInputs)
        if field.name.endswith(("age", "since_success")) or field.name == "path_offset"
    },
)


@given(inputs)
def test_no_input_breaks_the_rules_and_whatever_passes_is_finite_and_fresh(known):
    verdict = evaluate(known, SETTINGS)
    assert 0.0 <= verdict.scale <= 1.0
    assert all(reason.sentence for reason in verdict.reasons)
    if verdict.scale > 0.0:
        assert known.motion is known.command.kind
        assert known.command.age <= SETTINGS.command_age
        assert math.isfinite(known.command.v + known.command.w)
        assert known.estop is None


@pytest.mark.parametrize("name", ["slowest", "obstacle_slow"])
def test_a_share_of_the_speed_that_is_none_is_refused(name):
    with pytest.raises(ValueError, match=name):
        RuleSettings(**{name: 1.5})
