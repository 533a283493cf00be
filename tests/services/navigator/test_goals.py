"""Several goals: appended, swapped, dropped, with rests between them, and a pause at a vertex ahead."""

import pytest

from common.messages import Goal, StateName
from services.navigator.mission import MissionRefused
from services.navigator.unfinished import Unfinished
from tests.services.navigator.machines import END, FAR, OLD, START, following, name, new_machine, planning

S = StateName
RESTING = Goal(to="shed", pause_before=3.0)


@pytest.fixture
def machine():
    return new_machine()


def goals(machine):
    return [goal.to for goal in machine.mission.goals]


def test_goals_are_driven_to_one_after_another(machine):
    following(machine).append(4.0, FAR)
    machine.append(4.0, Goal(to="shed"))
    assert (machine.mission.destination, goals(machine)) == ("end", ["far", "shed"])
    machine.arrived(5.0, "route1")
    assert (name(machine), machine.mission.destination, goals(machine)) == (S.REPEAT_PLAN, "far", ["shed"])
    assert machine.mission.route == ""
    assert machine.mission.reason == "reached end, and goes on to far"
    attempt = machine.plans_anew()
    assert attempt
    assert machine.plans_anew() is None, "it is asked for once"
    assert machine.planned(6.0, attempt, "route2", OLD, "back")
    machine.localized(7.0, "route2", OLD)
    machine.arrived(8.0, "route1")
    assert name(machine) is S.REPEAT_FOLLOW
    machine.arrived(8.0, "route2")
    assert machine.mission.destination == "shed"


def test_the_robot_rests_between_goals_as_long_as_both_ask_for(machine):
    machine.repeat(0.0, "park", START, Goal(to="end", pause_after=2.0))
    machine.planned(1.0, machine.mission.attempt, "route1", START, "a map")
    machine.localized(2.0, "route1", START)
    machine.append(3.0, RESTING)
    machine.arrived(10.0, "route1")
    assert (name(machine), machine.mission.resumes) == (S.PAUSED, S.REPEAT_PLAN)
    assert machine.mission.waiting_for == "the end of the rest before shed"
    machine.tick(14.9)
    assert name(machine) is S.PAUSED
    machine.tick(15.0)
    assert (name(machine), machine.mission.destination) == (S.REPEAT_PLAN, "shed")
    assert machine.plans_anew()


def test_a_repeat_may_begin_with_a_rest(machine):
    assert machine.repeat(0.0, "park", START, RESTING) == 0
    assert name(machine) is S.PAUSED
    machine.tick(3.0)
    assert name(machine) is S.REPEAT_PLAN


def test_a_rest_can_be_cut_short_or_held_by_the_operator(machine):
    machine.repeat(0.0, "park", START, RESTING)
    machine.pause(1.0)
    machine.tick(100.0)
    assert (name(machine), machine.mission.waiting_for) == (S.PAUSED, "the operator, who resumes or cancels")
    machine.resume(101.0)
    assert name(machine) is S.REPEAT_PLAN


def test_the_present_goal_is_swapped_and_an_answer_about_the_old_one_ignored(machine):
    before = planning(machine).mission.attempt
    machine.append(2.0, Goal(to="shed"))
    attempt = machine.swap(3.0, FAR, "another goal")
    assert (name(machine), machine.mission.destination, goals(machine)) == (S.REPEAT_PLAN, "far", ["shed"])
    assert not machine.planned(4.0, before, "route1", START, "late")
    assert machine.planned(4.0, attempt, "route2", START, "in time")


def test_a_waiting_goal_is_dropped(machine):
    following(machine).append(4.0, FAR)
    machine.append(4.0, Goal(to="shed"))
    assert machine.drop(1) == FAR
    assert goals(machine) == ["shed"]
    for number in (0, 2):
        with pytest.raises(MissionRefused, match="no such goal"):
            machine.drop(number)


def test_a_waiting_goal_is_moved(machine):
    following(machine).append(4.0, FAR)
    for place in ("shed", "gate"):
        machine.append(4.0, Goal(to=place))
    assert machine.move(3, 1).to == "gate"
    assert goals(machine) == ["gate", "far", "shed"]
    machine.move(1, 2)
    assert goals(machine) == ["far", "gate", "shed"]
    for number, to in ((0, 1), (1, 4), (4, 1)):
        with pytest.raises(MissionRefused, match="no such goal"):
            machine.move(number, to)


def test_a_goal_that_cannot_be_planned_ends_the_repeat_and_says_why(machine):
    following(machine).append(4.0, FAR)
    machine.arrived(5.0, "route1")
    assert machine.not_planned(6.0, machine.plans_anew(), "no route to far: it is blocked")
    assert (name(machine), goals(machine)) == (S.IDLE, [])
    assert "blocked" in machine.mission.reason


def test_goals_outlive_the_navigator(machine):
    following(machine).append(4.0, RESTING)
    again = new_machine(Unfinished.of(machine.mission).mission(0.0, OLD))
    assert (again.mission.goal, again.mission.goals, name(again)) == (END, (RESTING,), S.PAUSED)
    again.resume(1.0)
    assert again.plans_anew()


def test_a_pause_at_a_vertex_lets_the_robot_drive_there(machine):
    following(machine).pause_ahead(4.0, OLD)
    assert (name(machine), machine.mission.pauses_at) == (S.REPEAT_FOLLOW, OLD)
    machine.arrived(5.0, "route1")
    assert (name(machine), machine.mission.resumes) == (S.PAUSED, S.REPEAT_FOLLOW)
    assert machine.mission.reason == f"paused by the operator at {OLD}"
    machine.resume(6.0)
    assert (name(machine), machine.mission.pauses_at) == (S.REPEAT_METRIC_LOCALIZE, None)
