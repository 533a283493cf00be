"""Merging: the operator's candidates, a loop closure that is offered, and the word that joins the maps or does not."""

import pytest

from common.ids import VertexId, new_map_id
from common.messages import StateName
from services.navigator.mission import MissionRefused
from services.navigator.unfinished import Unfinished
from tests.services.navigator.machines import CANDIDATES, OLD, START, merging, name, new_machine, offered, offered_now

S = StateName


@pytest.fixture
def machine():
    return new_machine()


def test_a_closure_is_offered_confirmed_and_ends_the_map(machine):
    assert merging(machine).mission.waiting_for == "a localization against one of 2 candidates"
    taught = machine.mission.map
    offered_now(machine, 6.0)
    assert "60 landmarks agree" in machine.mission.reason
    assert machine.mission.waiting_for == f"the operator, who confirms that the map meets {OLD}, or rejects it"
    before = machine.confirm(7.0)
    assert (before.map, before.closure.edge.b) == (taught, OLD)
    assert name(machine) is S.IDLE
    assert machine.mission.reason == f"finished map {taught.id}, which meets {OLD}"


def test_nothing_is_confirmed_that_was_not_offered(machine):
    merging(machine)
    for command in (machine.confirm, machine.reject):
        with pytest.raises(MissionRefused, match="there is no loop closure"):
            command(5.0)
    assert name(machine) is S.TEACH_MERGE


def test_a_rejected_candidate_is_tried_no_more_and_after_the_last_one_the_map_is_taught_on(machine):
    offered(machine).reject(6.0)
    assert (name(machine), machine.mission.candidates, machine.mission.closure) == (S.TEACH_MERGE, (START,), None)
    offered_now(machine, 7.0)
    assert machine.mission.closure is None, "a late word about the rejected one"
    offered_now(machine, 8.0, START)
    machine.reject(9.0)
    assert name(machine) is S.TEACH_BRANCH
    assert machine.mission.map is not None
    assert str(START) in machine.mission.reason


def test_an_offer_stays_until_it_is_answered(machine):
    first = offered(machine).mission.closure
    offered_now(machine, 6.0, START)
    assert machine.mission.closure is first


def test_a_closure_of_another_map_or_with_another_vertex_is_no_offer(machine):
    merging(machine)
    offered_now(machine, 5.0, VertexId(OLD.map_id, 9))
    assert machine.mission.closure is None
    machine.branch(6.0)
    offered_now(machine, 7.0)
    assert machine.mission.closure is None


@pytest.mark.parametrize(("reach", "seconds"), [(merging, 60.0), (offered, 120.0)])
def test_a_merge_that_takes_too_long_is_given_up_and_the_map_goes_on(machine, reach, seconds):
    taught = reach(machine).mission.map
    awaited, since = machine.mission.waiting_for, machine.mission.since
    machine.tick(since + seconds)
    assert name(machine) is S.TEACH_MERGE
    machine.tick(since + seconds + 0.1)
    assert (name(machine), machine.mission.map) == (S.TEACH_BRANCH, taught)
    assert awaited in machine.mission.reason


def test_other_candidates_may_be_named_and_the_map_ended_without_a_closure(machine):
    other = VertexId(new_map_id("r1", 5), 2)
    offered(machine).merge(6.0, (other,))
    assert (machine.mission.candidates, machine.mission.closure) == ((other,), None)
    assert machine.finish(7.0).map is not None
    assert name(machine) is S.IDLE


def test_a_pause_holds_the_candidates_and_forgets_the_offer(machine):
    offered(machine).lost(6.0, "lost the estimator")
    assert (name(machine), machine.mission.resumes) == (S.PAUSED, S.TEACH_MERGE)
    kept = Unfinished.of(machine.mission)
    again = new_machine(kept.mission(0.0, None))
    assert again.mission.map == machine.mission.map
    for one in (machine, again):
        one.resume(7.0)
        assert (name(one), one.mission.candidates, one.mission.closure) == (S.TEACH_MERGE, CANDIDATES, None)
