"""The navigator as a process, among sessions that act as the other processes."""

import contextlib

import numpy as np
import pytest

from common import topics
from common.errors import Refused
from common.geometry import from_xy_yaw
from common.ids import VertexId, new_map_id
from common.messages import (
    MapRecord,
    MapSummary,
    Route,
    SafetyCommand,
)
from tests.processes import Robot, eventually, every
from tests.services.navigator.crew import END, OLD, START, Crew, S


@pytest.fixture(scope="module")
def crew(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot"), "[navigator]\nfinish_s = 1.0\nplan_s = 1.0\ndata_s = 5.0\n") as robot:
        crew = Crew(robot)
        robot.start("navigator")
        eventually(crew.estimator.connected, "the sessions are connected")
        yield crew


@pytest.fixture
def idle(crew):
    """The robot in Idle with one stored map, and nothing missing."""
    for process in ("estimator", "tracker"):
        if process not in crew.robot._processes or not crew.robot.alive(process):
            crew.robot.stand_in(process)
    crew.ask("cancel")
    crew.found = None
    crew.store(OLD, finished=True)
    crew.until(S.IDLE)
    return crew


def resume(crew):
    """Resumes as soon as the navigator has heard that it can."""

    def resumed():
        with contextlib.suppress(Refused):
            return crew.ask("resume")

    eventually(resumed, "the mission is resumed")


def follow(crew):
    """Sends the robot to the end of the stored map and localizes it."""
    crew.ask("repeat", goal="end", vertex=START)
    state = crew.until(S.REPEAT_METRIC_LOCALIZE)
    with every(0.02, lambda: crew.localize(state.route)):
        return crew.until(S.REPEAT_FOLLOW)


@pytest.fixture
def lost(idle):
    """The robot where nothing is known of its place."""
    elsewhere = MapRecord(id=new_map_id("r1", 10**9), environment="default", stamp=0, robot="r1", sensor="stereo")
    idle.store(elsewhere, finished=True)
    idle.ask("position", vertex=VertexId(elsewhere.id, 0))
    idle.store(OLD, finished=True)
    return idle


def test_a_robot_that_does_not_know_its_place_looks_for_itself_before_a_repeat(lost):
    lost.found = END
    lost.ask("repeat", goal="end")
    assert lost.until(S.REPEAT_METRIC_LOCALIZE).position == END


def test_a_robot_that_does_not_find_itself_repeats_nothing_and_says_why(lost):
    sentence = r"it is unknown where the robot stands in 'default': name its vertex \(.* two places look alike\)"
    with pytest.raises(Refused, match=sentence):
        lost.ask("repeat", goal="end")
    assert lost.until(S.IDLE)


def test_a_map_is_taught_from_where_the_robot_finds_itself(lost):
    lost.found = END
    assert str(END) in lost.ask("teach")
    assert lost.until(S.TEACH_METRIC_LOCALIZE).target == END


def test_a_map_is_taught_unconnected_where_the_robot_does_not_find_itself(lost):
    text = lost.ask("teach")
    assert "joins no other" in text
    assert "two places look alike" in text
    assert lost.until(S.TEACH_BRANCH)


def test_an_operator_has_the_robot_look_for_itself(idle):
    idle.found = END
    assert idle.ask("position", find=True) == f"the robot stands at {END}: 87 landmarks agree"
    eventually(lambda: idle.state().position == END, "the position is known")
    idle.found = None
    with pytest.raises(Refused, match="two places look alike"):
        idle.ask("position", find=True)
    with pytest.raises(Refused, match="a position is a vertex"):
        idle.ask("position", find=True, vertex=END)
    eventually(lambda: idle.state().position == END, "the position is known")


def test_a_repeat_records_a_map_of_the_next_generation_until_it_ends(idle):
    recorded = follow(idle).map
    assert (recorded.generation, recorded.parent) == (OLD.generation + 1, OLD.id)
    idle.ask("pause")
    assert idle.until(S.PAUSED).map == recorded
    idle.ask("cancel")
    assert idle.until(S.IDLE).map is None
    assert follow(idle).map.id != recorded.id


def test_a_repeat_is_not_recorded_against_the_operator_s_wish(idle):
    idle.ask("repeat", goal="end", vertex=START, record=False)
    assert idle.until(S.REPEAT_METRIC_LOCALIZE).map is None


def test_a_map_is_taught_finished_and_its_ends_are_named(idle):
    idle.maps = []
    idle.ask("teach", start_place="gate")
    state = idle.until(S.TEACH_BRANCH)
    with every(0.02, lambda: idle.move(VertexId(state.map.id, 9))):
        eventually(lambda: idle.state().position == VertexId(state.map.id, 9), "the position follows the vertices")
    idle.store(state.map, finished=True)
    assert "10 vertices, 5.0 m" in idle.ask("finish", end_place="shed")
    assert idle.state().name is S.IDLE
    assert idle.places == {"gate": VertexId(state.map.id, 0), "shed": VertexId(state.map.id, 9)}


def test_a_map_that_does_not_reach_the_store_is_reported(idle):
    idle.maps = []
    idle.ask("teach")
    idle.until(S.TEACH_BRANCH)
    with pytest.raises(Refused, match="the store has no vertex of map"):
        idle.ask("finish")
    assert idle.until(S.IDLE)


def test_a_repeat_reaches_its_goal(idle):
    state = follow(idle)
    assert (state.goal, state.position) == ("end", START)
    with every(0.02, lambda: idle.track(state.route, finished=True)):
        assert idle.until(S.IDLE).reason == "reached end"


def test_the_route_is_there_for_whoever_joins_later(idle):
    state = follow(idle)
    routes = idle.robot.bus("estimator").subscribe(topics.ROUTE)
    assert eventually(routes.last, "the route arrives").message.id == state.route


@pytest.mark.parametrize("lost", ["estimator", "tracker"])
def test_a_killed_process_pauses_the_repeat_until_it_is_back(idle, lost):
    follow(idle)
    idle.robot.kill(lost)
    paused = idle.until(S.PAUSED)
    assert (paused.reason, paused.resumes) == (f"lost {lost}", S.REPEAT_FOLLOW)
    assert paused.waiting_for == "what was lost, to go on"
    with pytest.raises(Refused, match=f"cannot resume without {lost}"):
        idle.ask("resume")
    idle.robot.stand_in(lost)
    state = idle.until(S.REPEAT_METRIC_LOCALIZE)
    assert state.target == START
    assert state.reason == f"goes on, after: lost {lost}"


def test_a_pause_of_the_operator_s_does_not_end_by_itself(idle):
    follow(idle)
    idle.robot.kill("tracker")
    idle.until(S.PAUSED)
    idle.ask("pause")
    eventually(lambda: idle.state().waiting_for.startswith("the operator"), "it waits for the operator")
    idle.robot.stand_in("tracker")
    resume(idle)
    assert "resumed by the operator" in idle.until(S.REPEAT_METRIC_LOCALIZE).reason


def test_an_emergency_stop_pauses_the_repeat_until_it_is_reset_and_resumed(idle):
    follow(idle)
    idle.latch(latched=True)
    assert "emergency stop" in idle.until(S.PAUSED).reason
    with pytest.raises(Refused, match="reset it first"):
        idle.ask("resume")
    idle.latch(latched=False)
    resume(idle)
    assert idle.until(S.REPEAT_METRIC_LOCALIZE)


def test_refusals_say_why_and_change_nothing(idle):
    idle.robot.kill("estimator")
    cases = {
        "there is no place 'moon'": {"action": "repeat", "goal": "moon", "vertex": START},
        "environment 'default' has no vertex": {"action": "repeat", "goal": "end", "vertex": VertexId(OLD.id, 99)},
        "a repeat needs a goal": {"action": "repeat", "vertex": START},
        "has no map that could be repeated": {"action": "repeat", "goal": "end"},
        "no map is being taught": {"action": "finish"},
        "nothing to pause": {"action": "pause"},
        "nothing to resume": {"action": "resume"},
        "has no vertex": {"action": "position", "vertex": VertexId(OLD.id, 99)},
        "a position is a vertex": {"action": "position"},
    }
    with pytest.raises(Refused, match="cannot repeat without estimator: not running"):
        idle.ask("repeat", goal="end", vertex=START)
    idle.robot.stand_in("estimator")
    for sentence, order in cases.items():
        idle.maps = [] if "no map that" in sentence else idle.maps
        with pytest.raises(Refused, match=sentence):
            idle.ask(**order)
        idle.store(OLD, finished=True)
        assert idle.until(S.IDLE)


def test_a_planner_that_hangs_ends_in_idle_and_the_state_is_published_all_the_while(idle):
    idle.planner_works.clear()
    arrived = []
    try:
        with (
            every(0.01, lambda: arrived.extend(filter(None, [idle.states.poll()]))),
            pytest.raises(Refused, match="nobody answers 'plan'"),
        ):
            idle.ask("repeat", goal="end", vertex=START)
    finally:
        idle.planner_works.set()
    assert sum(received.message.name is S.REPEAT_PLAN for received in arrived) >= 5
    assert "no route to end" in idle.until(S.IDLE).reason


def test_a_killed_navigator_comes_back_idle_and_knows_where_the_robot_stands(idle):
    idle.ask("position", vertex=END)
    file = idle.robot.folder / "r1" / "run" / "position.json"
    eventually(lambda: file.exists() and str(END) in file.read_text(), "the position is kept")
    idle.robot.kill("navigator")
    idle.robot.start("navigator")
    state = eventually(lambda: s if (s := idle.state()).reason == "started" else None, "a new navigator's state")
    assert (state.name, state.position) == (S.IDLE, END)


def test_nonsense_changes_nothing(idle):
    key = topics.MISSION.at("r1")
    for payload in (b"", b"VTR1", bytes(64), b"\xff" * 200):
        replies = list(idle.operator.session.get(key, payload=payload, timeout=5.0))
        assert all(reply.err is not None for reply in replies)
    with pytest.raises(Refused):
        idle.operator.ask(topics.MISSION, SafetyCommand(action="stop"))
    assert idle.until(S.IDLE)
    assert idle.robot.alive("navigator")


OTHER = MapRecord(id=new_map_id("r2", 5 * 10**9), environment="default", stamp=0, robot="r2", sensor="stereo")


def two_maps(name, *, reached):
    """A route over the stored map, and as far as is known over another one."""
    vertices = [START, END] + ([VertexId(OTHER.id, 0), VertexId(OTHER.id, 9)] if reached else [])
    return Route(
        id=name, environment="default", goal="end", vertices=vertices,
        path=np.stack([from_xy_yaw(5.0 * k, 0, 0) for k in range(len(vertices))]), length=5.0, maps=[OLD.id],
        reason="chosen", plan=[OLD.id, OTHER.id], next_map=None if reached else OTHER.id,
    )  # fmt: skip


@pytest.fixture
def fleet(idle):
    """The robot with a plan over two maps, of which it knows no joint."""
    idle.maps = [
        MapSummary(record=OLD, vertices=10, length=5.0, bytes=1, finished=True, start_place="gate", end_place="yard"),
        MapSummary(record=OTHER, vertices=10, length=5.0, bytes=1, finished=True, start_place="yard", end_place="end"),
    ]
    idle.reports.clear()
    idle.ends.clear()
    plan, idle.plan_of = idle.plan_of, lambda _: two_maps("short", reached=False)
    yield idle
    idle.plan_of, idle.longer, idle.fetching = plan, None, ""


def test_a_plan_whose_maps_are_fetched_is_waited_for(fleet):
    fleet.fetching = "fetching 1 of the plan's 2 maps, 40 %"
    assert "fetching 1" in fleet.ask("repeat", goal="end", start_place="gate")
    eventually(lambda: "40 %" in fleet.until(S.REPEAT_PLAN).waiting_for, "the state says what it waits for")
    fleet.fetching = "fetching 1 of the plan's 2 maps, 90 %"
    eventually(lambda: "90 %" in fleet.state().waiting_for, "the state says how far it is")
    fleet.fetching = ""
    fleet.until(S.REPEAT_METRIC_LOCALIZE)


def test_a_plan_that_is_fetched_can_be_cancelled(fleet):
    fleet.fetching = "fetching 1 of the plan's 2 maps"
    fleet.ask("repeat", goal="end", start_place="gate")
    fleet.until(S.REPEAT_PLAN)
    fleet.ask("cancel")
    fleet.until(S.IDLE)
    fleet.fetching = ""


def follow_both(crew, route="short", trunk=START):
    """Keeps the robot localized on a route until it follows it."""
    crew.ask("repeat", goal="end", vertex=START, record=True)
    crew.until(S.REPEAT_METRIC_LOCALIZE)
    with every(0.02, lambda: crew.localize(route, trunk)):
        return crew.until(S.REPEAT_FOLLOW)


def moving(crew, route, trunk):
    """The robot drives on: localizations, odometry and the tracker's status."""
    crew.localize(crew.state().route or route, trunk)
    crew.move(None)
    crew.track(crew.state().route)


def test_a_route_goes_on_without_a_stop_and_another_map_is_recorded(fleet):
    first = follow_both(fleet)
    fleet.longer = two_maps("long", reached=True)
    with every(0.03, lambda: moving(fleet, "short", END)):
        state = eventually(lambda: (s := fleet.state()).route == "long" and s, "the longer route is followed")
    assert (state.name, state.extends, state.since) == (S.REPEAT_FOLLOW, "short", first.since)
    assert state.map.parent == OLD.id
    with every(0.03, lambda: moving(fleet, "long", VertexId(OTHER.id, 1))):
        state = eventually(lambda: (s := fleet.state()).map.parent == OTHER.id and s, "the other map is recorded")
    assert state.map.generation == 1
    with every(0.03, lambda: fleet.track("long", finished=True)):
        fleet.until(S.IDLE)
    report = eventually(lambda: fleet.reports and fleet.reports[-1], "the repeat is reported")
    assert [told.map for told in report.maps] == [OLD.id, OTHER.id]


def test_at_an_end_without_a_joint_the_robot_finds_itself_on_the_next_map(fleet):
    follow_both(fleet)
    fleet.longer = two_maps("short", reached=False)
    following = Route(
        id="next", environment="default", goal="end", vertices=[VertexId(OTHER.id, 0)], path=np.eye(4)[None],
        length=0.0, maps=[OTHER.id], reason="the rest", plan=[OTHER.id],
    )  # fmt: skip
    fleet.plan_of = lambda question: following if question.plan == [OTHER.id] else two_maps("short", reached=False)
    fleet.longer = None
    with every(0.03, lambda: (moving(fleet, "short", END), fleet.track("short", finished=True))):
        state = fleet.until(S.REPEAT_METRIC_LOCALIZE)
    assert (state.route, state.target) == ("next", VertexId(OTHER.id, 0))
    assert "no edge leads" in state.reason


def test_the_ends_of_a_taught_map_are_told(idle):
    idle.ends.clear()
    idle.ask("teach", vertex=END, start_place="yard")
    state = idle.until(S.TEACH_METRIC_LOCALIZE)
    with every(0.02, lambda: idle.localize("", END)):
        state = idle.until(S.TEACH_BRANCH)
    idle.store(state.map, finished=True)
    idle.ask("finish", end_place="shed")
    assert idle.ends[state.map.id] == ("yard", "shed")


def test_a_navigator_that_is_started_anew_is_paused_with_its_goal(idle):
    follow(idle)
    idle.robot.kill("navigator")
    idle.robot.start("navigator")
    state = idle.until(S.PAUSED)
    assert (state.goal, state.resumes, state.position) == ("end", S.REPEAT_PLAN, START)
    assert "started anew" in state.reason
    resume(idle)
    assert idle.until(S.REPEAT_METRIC_LOCALIZE).target == START


def test_a_navigator_that_is_started_anew_still_teaches_its_map(idle):
    idle.store(OLD, finished=True)
    idle.ask("teach", vertex=END)
    with every(0.02, lambda: idle.localize("", END)):
        taught = idle.until(S.TEACH_BRANCH).map
    idle.robot.kill("navigator")
    idle.robot.start("navigator")
    assert idle.until(S.PAUSED).map == taught
    resume(idle)
    assert idle.until(S.TEACH_BRANCH).map == taught


def test_a_mission_that_is_over_is_forgotten(idle):
    follow(idle)
    idle.ask("cancel")
    idle.until(S.IDLE)
    idle.robot.kill("navigator")
    idle.robot.start("navigator")
    assert idle.until(S.IDLE).goal == ""
