"""The state machine without a bus: every transition, every refusal, every deadline."""

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.ids import VertexId
from common.messages import Goal, StateName
from services.navigator.hierarchy import TABLE, diagram
from services.navigator.machine import StateMachine
from services.navigator.mission import MissionRefused
from tests.services.navigator.machines import (
    CANDIDATES,
    END,
    FAR,
    OLD,
    REACH,
    START,
    TAUGHT,
    branching,
    following,
    joining,
    localizing,
    name,
    new_machine,
    offered_now,
    paused,
    paused_teach,
    planning,
)

S = StateName


@pytest.fixture
def machine() -> StateMachine:
    return new_machine()


def test_every_state_can_be_reached():
    assert set(REACH) == set(StateName)
    for state, reach in REACH.items():
        assert name(reach(new_machine())) is state


def test_the_first_map_needs_no_localization(machine):
    machine.teach(1.0, "park", None, "gate")
    assert name(machine) is S.TEACH_BRANCH
    assert machine.mission.map is not None
    assert machine.mission.map.environment == "park"
    assert machine.mission.start_place == "gate"


def test_a_map_that_joins_another_is_taught_once_the_robot_is_localized_at_its_vertex(machine):
    joining(machine)
    assert machine.mission.target == OLD
    assert machine.mission.map is None
    machine.localized(2.0, "", START)
    assert name(machine) is S.TEACH_METRIC_LOCALIZE
    machine.localized(2.0, "route1", OLD)
    assert name(machine) is S.TEACH_METRIC_LOCALIZE
    machine.localized(2.0, "", OLD)
    assert name(machine) is S.TEACH_BRANCH
    assert machine.mission.map is not None


def test_teaching_keeps_the_position_at_the_last_vertex(machine):
    branching(machine)
    taught = machine.mission.map
    machine.made_vertex(VertexId(taught.id, 7))
    machine.made_vertex(OLD)
    assert machine.finish(5.0).map == taught
    assert machine.mission.position == VertexId(taught.id, 7)
    assert name(machine) is S.IDLE
    assert machine.mission.map is None


def test_a_repeat_goes_through_plan_and_localization_to_its_goal(machine):
    following(machine)
    machine.localized(4.0, "route1", OLD)
    assert machine.mission.position == OLD
    machine.arrived(5.0, "another")
    assert name(machine) is S.REPEAT_FOLLOW
    machine.arrived(5.0, "route1")
    assert name(machine) is S.IDLE
    assert machine.mission.reason == "reached end"
    assert machine.mission.route == ""


def recording(machine: StateMachine) -> StateMachine:
    planning(machine).planned(2.0, machine.mission.attempt, "route1", START, "one map", TAUGHT)
    return machine


def test_a_recorded_repeat_has_a_map_of_its_own_to_its_end_and_over_pauses(machine):
    recorded = recording(machine).mission.map
    assert (recorded.generation, recorded.parent, recorded.environment) == (1, TAUGHT.id, "park")
    machine.localized(3.0, "route1", START)
    assert machine.mission.map is recorded
    machine.pause(4.0)
    assert machine.mission.map is recorded
    machine.resume(5.0)
    machine.localized(6.0, "route1", START)
    assert (name(machine), machine.mission.map) == (S.REPEAT_FOLLOW, recorded)
    machine.made_vertex(VertexId(recorded.id, 3))
    assert machine.mission.position == START, "the robot's place is told in what was taught"
    machine.arrived(7.0, "route1")
    assert machine.mission.map is None
    assert recording(machine).mission.map.id != recorded.id


def test_a_repeat_that_is_not_to_be_recorded_has_no_map(machine):
    assert following(machine).mission.map is None


def test_a_map_that_a_repeat_records_is_not_finished_as_a_taught_one(machine):
    recording(machine).localized(3.0, "route1", START)
    with pytest.raises(MissionRefused, match="no map is being taught"):
        machine.finish(4.0)
    machine.pause(5.0)
    with pytest.raises(MissionRefused, match="no map is being taught"):
        machine.finish(6.0)


def test_a_plan_that_arrives_during_a_pause_brings_its_map(machine):
    attempt = planning(machine).mission.attempt
    machine.pause(2.0)
    assert machine.planned(3.0, attempt, "route1", START, "one map", TAUGHT)
    recorded = machine.mission.map
    machine.resume(4.0)
    assert recorded is not None
    assert machine.mission.map is recorded


def test_a_localization_on_another_route_starts_nothing(machine):
    localizing(machine)
    machine.localized(3.0, "another", START)
    machine.localized(3.0, "", START)
    assert name(machine) is S.REPEAT_METRIC_LOCALIZE


def test_the_planners_refusal_ends_in_idle_with_its_words(machine):
    planning(machine)
    assert machine.not_planned(2.0, machine.mission.attempt, "no route: there is no place 'moon'")
    assert name(machine) is S.IDLE
    assert "moon" in machine.mission.reason


def test_an_answer_to_a_cancelled_question_is_ignored(machine):
    attempt = planning(machine).mission.attempt
    machine.cancel(2.0)
    assert not machine.planned(3.0, attempt, "route1", START, "late")
    again = machine.repeat(4.0, "park", START, END)
    assert not machine.planned(5.0, attempt, "route1", START, "late")
    assert name(machine) is S.REPEAT_PLAN
    assert machine.planned(6.0, again, "route2", START, "in time")


def test_a_plan_that_arrives_during_a_pause_is_kept_and_starts_nothing(machine):
    attempt = planning(machine).mission.attempt
    machine.pause(2.0)
    assert machine.planned(3.0, attempt, "route1", START, "one map")
    assert name(machine) is S.PAUSED
    machine.resume(4.0)
    assert name(machine) is S.REPEAT_METRIC_LOCALIZE
    assert machine.mission.route == "route1"


def test_a_resumed_repeat_is_localized_anew_where_it_was_localized_last(machine):
    following(machine)
    machine.localized(4.0, "route1", OLD)
    machine.lost(5.0, "lost the estimator")
    assert name(machine) is S.PAUSED
    assert machine.mission.resumes is S.REPEAT_FOLLOW
    assert machine.mission.reason == "lost the estimator"
    machine.localized(5.5, "route1", OLD)
    assert name(machine) is S.PAUSED
    machine.resume(6.0)
    assert name(machine) is S.REPEAT_METRIC_LOCALIZE
    assert machine.mission.target == OLD
    machine.localized(7.0, "route1", OLD)
    assert name(machine) is S.REPEAT_FOLLOW
    assert machine.mission.resumes is None


def test_a_resumed_teach_goes_on_with_the_same_map(machine):
    taught = paused_teach(machine).mission.map
    machine.resume(5.0)
    assert name(machine) is S.TEACH_BRANCH
    assert machine.mission.map == taught


def test_a_resumed_search_for_the_start_of_a_map_goes_on(machine):
    joining(machine).pause(2.0)
    machine.resume(3.0)
    assert name(machine) is S.TEACH_METRIC_LOCALIZE
    assert machine.mission.target == OLD


def test_a_paused_teach_can_be_finished(machine):
    assert paused_teach(machine).finish(5.0).map is not None
    assert name(machine) is S.IDLE


@pytest.mark.parametrize(
    ("state", "seconds"),
    [(S.TEACH_METRIC_LOCALIZE, 20), (S.REPEAT_PLAN, 3), (S.REPEAT_METRIC_LOCALIZE, 20), (S.PAUSED, 100)],
)
def test_a_waiting_state_gives_up_at_its_deadline(machine, state, seconds):
    REACH[state](machine)
    awaited = machine.mission.waiting_for
    machine.tick(machine.mission.since + seconds)
    assert name(machine) is state
    machine.tick(machine.mission.since + seconds + 0.1)
    assert name(machine) is S.IDLE
    assert awaited in machine.mission.reason


@pytest.mark.parametrize("state", [S.IDLE, S.TEACH_BRANCH, S.REPEAT_FOLLOW])
def test_a_state_that_waits_for_nobody_has_no_deadline(machine, state):
    REACH[state](machine)
    machine.tick(1e9)
    assert name(machine) is state


COMMANDS = {
    "teach": lambda machine: machine.teach(9.0, "park", None),
    "finish": lambda machine: machine.finish(9.0),
    "repeat": lambda machine: machine.repeat(9.0, "park", START, END),
    "pause": lambda machine: machine.pause(9.0),
    "resume": lambda machine: machine.resume(9.0),
    "position": lambda machine: machine.stand_at("park", OLD),
    "merge": lambda machine: machine.merge(9.0, CANDIDATES),
    "confirm": lambda machine: machine.confirm(9.0),
    "branch": lambda machine: machine.branch(9.0),
    "append": lambda machine: machine.append(9.0, FAR),
    "swap": lambda machine: machine.swap(9.0, FAR, "another goal"),
    "pause_ahead": lambda machine: machine.pause_ahead(9.0, OLD),
}
REPEATS = {S.REPEAT_PLAN, S.REPEAT_METRIC_LOCALIZE, S.REPEAT_FOLLOW, S.PAUSED}
ALLOWED = {
    "teach": {S.IDLE},
    "finish": {S.TEACH_BRANCH, S.TEACH_MERGE},
    "repeat": {S.IDLE},
    "pause": {
        S.TEACH_METRIC_LOCALIZE,
        S.TEACH_BRANCH,
        S.TEACH_MERGE,
        S.REPEAT_PLAN,
        S.REPEAT_METRIC_LOCALIZE,
        S.REPEAT_FOLLOW,
    },
    "resume": {S.PAUSED},
    "position": {S.IDLE} | REPEATS,
    "merge": {S.TEACH_BRANCH, S.TEACH_MERGE},
    "confirm": set(),
    "branch": {S.TEACH_MERGE},
    "append": REPEATS,
    "swap": REPEATS,
    "pause_ahead": {S.REPEAT_FOLLOW},
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("state", list(StateName))
def test_a_command_that_does_not_fit_is_refused_in_one_sentence_and_changes_nothing(command, state):
    machine = REACH[state](new_machine())
    before = machine.mission
    if state in ALLOWED[command]:
        machine.check(command)
        COMMANDS[command](machine)
        return
    for ask in (lambda: machine.check(command), lambda: COMMANDS[command](machine)):
        with pytest.raises(MissionRefused) as refused:
            ask()
        assert re.fullmatch(r"[^\n.]+(\.[A-Z][^\n.]+)?", str(refused.value))
        assert machine.mission is before


def test_a_refusal_names_what_a_pause_holds(machine):
    with pytest.raises(MissionRefused, match=r"paused in Repeat\.Follow"):
        paused(machine).teach(9.0, "park", None)


def test_the_position_belongs_to_its_environment(machine):
    machine.stand_at("yard", OLD)
    assert (machine.mission.environment, machine.mission.position) == ("yard", OLD)


def test_the_diagram_shows_every_state_and_every_event():
    text = diagram()
    assert text.startswith("stateDiagram-v2")
    for state in StateName:
        assert state.value.rpartition(".")[2] in text
    for row in TABLE:
        assert row.event in text
    assert "Repeat_MetricLocalize --> Repeat_Follow: localized" in text


EVENTS = {
    **COMMANDS,
    "join": lambda machine: machine.teach(9.0, "park", OLD),
    "cancel": lambda machine: machine.cancel(9.0),
    "planned": lambda machine: machine.planned(9.0, machine.mission.attempt, "route1", START, "planned"),
    "planned to record": lambda machine: machine.planned(
        9.0, machine.mission.attempt, "route1", START, "planned", TAUGHT
    ),
    "stale plan": lambda machine: machine.planned(9.0, 99, "route9", START, "planned"),
    "not_planned": lambda machine: machine.not_planned(9.0, machine.mission.attempt, "no route"),
    "localized": lambda machine: machine.localized(9.0, machine.mission.route, machine.mission.target or START),
    "localized elsewhere": lambda machine: machine.localized(9.0, "route9", START),
    "made_vertex": lambda machine: machine.made_vertex(OLD),
    "offered": lambda machine: offered_now(machine, 9.0),
    "reject": lambda machine: machine.reject(9.0),
    "append and rest": lambda machine: machine.append(9.0, Goal(to="far", pause_before=5.0)),
    "drop": lambda machine: machine.drop(1),
    "planned anew": lambda machine: machine.plans_anew(),
    "arrived": lambda machine: machine.arrived(9.0, machine.mission.route),
    "lost": lambda machine: machine.lost(9.0, "lost the estimator"),
    "tick": lambda machine: machine.tick(9.0),
    "much later": lambda machine: machine.tick(1e6),
}


@given(st.lists(st.sampled_from(sorted(EVENTS)), max_size=40))
def test_whatever_happens_cancel_ends_in_idle_and_only_a_localization_starts_following(events):
    machine = new_machine()
    for event in events:
        before = machine.mission
        try:
            EVENTS[event](machine)
        except MissionRefused:
            assert machine.mission is before
        after = machine.mission
        if after.name is S.REPEAT_FOLLOW and before.name is not S.REPEAT_FOLLOW:
            assert event == "localized"
            assert before.name is S.REPEAT_METRIC_LOCALIZE
        taught = bool({S.TEACH_BRANCH, S.TEACH_MERGE} & {after.name, after.resumes})
        recorded = after.map is not None and after.map.generation == 1
        assert taught == (after.map is not None and not recorded)
        assert not recorded or after.route
        assert (after.resumes is not None) == (after.name is S.PAUSED)
        assert not after.closure or after.name is S.TEACH_MERGE
        assert not after.pauses_at or after.name is S.REPEAT_FOLLOW
    machine.cancel(10.0)
    assert name(machine) is S.IDLE
    assert machine.mission.map is None


def recovering(machine):
    """A repeat that was lost on the way, in a machine that may go on by itself within ten seconds."""
    machine._deadlines = replace(machine._deadlines, recover=10.0)
    following(machine)
    machine.localized(4.0, "route1", OLD)
    machine.lost(5.0, "lost the estimator")
    return machine


def test_what_was_lost_is_waited_for_and_then_it_goes_on(machine):
    recovering(machine)
    assert machine.mission.waiting_for == "what was lost, to go on"
    machine.recovered(6.0)
    assert name(machine) is S.REPEAT_METRIC_LOCALIZE
    assert machine.mission.target == OLD
    assert machine.mission.recovery == 0.0
    machine.recovered(7.0)
    assert name(machine) is S.REPEAT_METRIC_LOCALIZE


def test_what_does_not_come_back_ends_in_idle_with_the_reason(machine):
    recovering(machine)
    machine.tick(14.9)
    assert name(machine) is S.PAUSED
    machine.tick(15.1)
    assert name(machine) is S.IDLE
    assert "lost the estimator" in machine.mission.reason


def test_an_operator_s_pause_holds_what_would_have_gone_on(machine):
    recovering(machine)
    machine.pause(6.0)
    machine.recovered(7.0)
    assert name(machine) is S.PAUSED
    assert machine.mission.reason == "paused by the operator, after: lost the estimator"
    with pytest.raises(MissionRefused):
        machine.pause(8.0)


def test_a_pause_by_the_operator_never_ends_by_itself(machine):
    following(machine)
    machine.pause(5.0)
    machine.recovered(6.0)
    assert name(machine) is S.PAUSED
