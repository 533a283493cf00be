"""What an operator is told that happened."""

from common.messages import SafetyStatus, State, StateName, StopReason
from services.console.robot.models.mission import runs
from services.console.robot.models.timeline import Timeline
from tests.services.console.acting import VertexId


def state(name, reason):
    return State(stamp=1, name=name, environment="default", since=1, reason=reason)


def status(*rules, latched=False):
    reasons = [StopReason(rule=rule, text=f"{rule}!") for rule in rules]
    return SafetyStatus(stamp=1, passing=not rules, scale=1.0, latched=latched, reasons=reasons)


def test_a_state_is_told_once():
    timeline = Timeline()
    assert [event.text for event in timeline.state(state(StateName.IDLE, "started"))] == ["Idle: started"]
    assert list(timeline.state(state(StateName.IDLE, "started"))) == []
    (event,) = timeline.state(state(StateName.PAUSED, "lost the estimator"))
    assert event.bad


def test_of_safety_each_new_reason_and_its_end():
    timeline = Timeline()
    assert list(timeline.safety(status("state_forbids"))) == []
    assert [event.text for event in timeline.safety(status("obstacle", "uncertain"))] == ["obstacle!", "uncertain!"]
    assert list(timeline.safety(status("obstacle"))) == []
    assert [event.bad for event in timeline.safety(status())] == [False]
    list(timeline.safety(status("emergency_stop", latched=True)))
    assert "released" in next(iter(timeline.safety(status()))).text


def test_processes_come_and_go():
    timeline = Timeline()
    assert list(timeline.presence(frozenset({"safety", "tracker"}))) == []
    events = list(timeline.presence(frozenset({"safety", "planner", "operator"})))
    assert [(event.text, event.bad) for event in events] == [("tracker has gone", True), ("planner is there", False)]


def test_a_route_is_told_as_runs():
    a, b = "20261122T204500123456-r1-9f3c1a", "20261122T204500123456-r1-9f3c1b"
    vertices = [VertexId(a, 3), VertexId(a, 4), VertexId(a, 5), VertexId(b, 9), VertexId(b, 8), VertexId(b, 9)]
    assert runs(vertices) == [[a, 3, 5], [b, 9, 8], [b, 9, 9]]
