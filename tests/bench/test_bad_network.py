"""The judge of the bad network finds what it is there to find."""

import pytest

from bench.bad_network.judge import judge
from bench.bad_network.plan import PARTITION_S, Partition, Plan

MAP = "20261126T151220600866-r1-92cf08"
PLAN = Plan(100.0, 60.0, ("r1",), 0.1, 0.05, (Partition(30.0, 60.0, ("r1",)),), ((10.0, "r1"),))


def line(t, kind, **fields):
    return {"t": 100.0 + t, "kind": kind, "robot": "r1", **fields}


@pytest.fixture
def run():
    """A run that is well: its logs, the robot's store and the server's storage."""
    agent = [
        line(1.0, "moves"),
        line(2.0, "commit", map=MAP, index=0, crc=7),
        line(3.0, "commit", map=MAP, index=1, crc=8),
        line(10.4, "rests"),
        line(15.0, "moves"),
        line(31.2, "rests"),
        line(61.0, "finished", map=MAP),
        line(70.0, "shared"),
        line(71.0, "driven", metres=20.0),
    ]
    operator = [
        line(10.0, "stop", number=0),
        line(10.3, "latched", number=0),
        line(13.3, "release", number=0),
        line(13.6, "reset", number=0),
        line(69.0, "known", map=MAP),
    ]
    server = {"metadata": [MAP], "archives": ["a"], "contents": {MAP: [7, 8]}}
    return agent, operator, {"r1": {MAP: [7, 8]}}, server


def wrong(run):
    return judge(PLAN, *run).wrong


def test_a_run_that_is_well(run):
    verdict = judge(PLAN, *run)
    assert verdict.wrong == []
    assert verdict.figures["in_sync_s"] == pytest.approx(10.0)
    assert verdict.figures["rest_s_most"] == pytest.approx(0.4)


@pytest.mark.parametrize("stored", [[7], [7, 8, 8], [7, 9]], ids=["lost", "doubled", "changed"])
def test_a_commit_that_is_not_once_where_it_must_be(run, stored):
    agent, operator, robots, server = run
    assert "store of r1" in wrong((agent, operator, {"r1": {MAP: stored}}, server))[0]
    assert "fleet's storage" in wrong((agent, operator, robots, {**server, "contents": {MAP: stored}}))[0]


def test_a_map_that_is_there_twice(run):
    agent, operator, robots, server = run
    assert "2 metadata" in wrong((agent, operator, robots, {**server, "metadata": [MAP, MAP]}))[0]


def test_a_robot_that_drives_on_after_an_emergency_stop(run):
    agent, *rest = run
    late = [{**k, "t": 112.9} if k["kind"] == "rests" and k["t"] < 115 else k for k in agent]
    assert "2.9 s after" in wrong((late, *rest))[0]


def test_a_robot_that_creeps_between_a_stop_and_its_release(run):
    agent, *rest = run
    crept = [*agent[:4], line(12.0, "moves"), line(12.1, "rests"), *agent[4:]]
    assert "moved between" in wrong((crept, *rest))[0]


def test_an_emergency_stop_that_never_arrives(run):
    agent, operator, *rest = run
    assert "never arrived" in wrong((agent, [operator[0], operator[-1]], *rest))[-1]


def test_a_robot_that_moves_while_it_is_cut_off(run):
    agent, *rest = run
    moved = [*agent[:6], line(40.0, "moves"), line(41.0, "rests"), *agent[6:]]
    assert "cut off at 30 s" in wrong((moved, *rest))[0]


def test_what_is_in_sync_too_late_or_never(run):
    agent, operator, *rest = run
    assert "only 90 s" in wrong((agent, [*operator[:-1], line(150.0, "known", map=MAP)], *rest))[0]
    assert "not in sync" in wrong(([k for k in agent if k["kind"] != "shared"], operator, *rest))[0]
    assert "lists 0 of 1" in wrong((agent, operator[:-1], *rest))[0]


def test_a_plan_cuts_everybody_off_at_the_end_and_is_read_as_it_was_written():
    plan = Plan.of(10, 600.0, 0.1, 0.05, seed=1)
    assert plan.partitions[-1] == Partition(600.0 - PARTITION_S, 600.0, plan.robots)
    assert {robot for _, robot in plan.stops} == set(plan.robots)
    assert any(plan.cut(robot, at) for at, robot in plan.stops)
    assert Plan.parse(plan.text()) == plan
