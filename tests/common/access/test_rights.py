"""What each may do, decided over Zenoh's own key expressions as its router decides it."""

import re

import pytest
from zenoh import KeyExpr

from cli.processes import OPTIONAL, ROBOT
from common import topics
from common.access import control, rights
from common.access.names import Role
from common.access.rights import Flow, Kind
from common.topics import ALL, FLEET, OF_THE_FLEET, Delivery
from tests.processes import ROOT


def may(granted, kind, flow, key):
    """Whether a right covers a key expression, as a default of deny with rules that allow does."""
    return any(
        KeyExpr(covered).includes(KeyExpr(key))
        for right in granted
        if right.kind is kind and right.flow is flow
        for covered in right.keys
    )


def sends(granted, key):
    return may(granted, Kind.SAMPLES, Flow.INGRESS, key)


def asks(granted, key):
    return may(granted, Kind.QUESTIONS, Flow.INGRESS, key)


PUBLISHED = [topic for topic in ALL if topic.delivery is not Delivery.QUERY]
ASKED = [topic for topic in ALL if topic.delivery is Delivery.QUERY]
PEOPLE = {"operator": rights.of_operator(), "viewer": rights.of_viewer()}


@pytest.mark.parametrize("topic", PUBLISHED, ids=lambda topic: topic.key)
def test_of_a_robots_processes_a_topics_owners_alone_send_it(topic):
    name = "front" if "{" in topic.key else ""
    for process in rights.processes():
        own = topic.owners == ("*",) or process in topic.owners
        key = topic.at("r1", process if topic.owners == ("*",) else name)
        assert sends(rights.of_process("r1", process), key) is own, process


def test_safety_alone_sends_what_drives_the_base():
    key = topics.SAFE.at("r1")
    assert [p for p in rights.processes() if sends(rights.of_process("r1", p), key)] == ["safety"]
    outside = (rights.of_uplink("r1"), rights.of_server(), *PEOPLE.values(), rights.of_robot("r2"))
    assert not any(sends(granted, key) for granted in outside)


@pytest.mark.parametrize("topic", ASKED, ids=lambda topic: topic.key)
def test_a_question_that_changes_something_is_for_its_askers(topic):
    for process in rights.processes():
        allowed = topic.askers == ("*",) or process in topic.askers
        assert asks(rights.of_process("r1", process), topic.at("r1")) is allowed, process
    assert asks(PEOPLE["viewer"], topic.at("r1")) is (topic.askers == ("*",))
    assert asks(PEOPLE["operator"], topic.at("r1")) is (topic.askers == ("*",) or "operator" in topic.askers)
    assert asks(rights.of_uplink("r1"), topic.at("r1")) is asks(PEOPLE["operator"], topic.at("r1"))


@pytest.mark.parametrize("key", ["**", "vtr/**", "vtr/*/command/*", "vtr/r1/**", "vtr/*/command/safe"])
def test_nobody_who_may_not_send_a_key_sends_to_many_at_once(key):
    outside = (rights.of_uplink("r1"), rights.of_server(), *PEOPLE.values(), rights.of_robot("r2"))
    inside = [rights.of_process("r1", p) for p in rights.processes() if p != "safety"]
    assert not any(sends(granted, key) for granted in (*outside, *inside))
    assert not asks(PEOPLE["viewer"], key)


def test_a_viewer_sends_nothing_at_all():
    viewer = rights.of_viewer()
    kinds = {right.kind for right in viewer if right.flow is Flow.INGRESS}
    assert kinds == {Kind.QUESTIONS, Kind.SUBSCRIPTIONS, Kind.TOKENS}
    for process in ("navigator", "safety", "*"):
        assert not may(viewer, Kind.TOKENS, Flow.INGRESS, f"vtr/r1/alive/{process}")
        assert not may(viewer, Kind.TOKENS, Flow.INGRESS, f"vtr/r1/life/{process}/00aabbcc")


def test_a_robot_writes_its_own_keys_and_hears_of_no_others():
    granted = rights.of_robot("r1")
    for topic in PUBLISHED:
        assert sends(granted, topic.at("r1", "front"))
        assert not sends(granted, topic.at("r2", "front"))
        assert not may(granted, Kind.SAMPLES, Flow.EGRESS, topic.at("r2", "front"))
    assert not may(granted, Kind.SUBSCRIPTIONS, Flow.INGRESS, "vtr/r2/state")
    assert not may(granted, Kind.TOKENS, Flow.INGRESS, "vtr/r2/alive/navigator")
    assert not sends(granted, "vtr/r10/state")


def test_a_robot_hears_the_servers_health_and_models():
    for key in (topics.HEALTH.at(FLEET, "router"), topics.MODEL.at("", "yard")):
        assert may(rights.of_server(), Kind.SAMPLES, Flow.INGRESS, key)
        assert may(rights.of_robot("r1"), Kind.SAMPLES, Flow.EGRESS, key)
        assert sends(rights.of_uplink("r1"), key)


def test_a_robot_asks_the_server_all_but_what_is_an_operators():
    for topic in OF_THE_FLEET:
        if topic.delivery is Delivery.QUERY:
            assert asks(rights.of_robot("r1"), topic.at("", "yard")) is (topic is not topics.REBUILD)


def test_a_late_joiner_may_ask_for_every_state():
    readers = [*PEOPLE.values(), rights.of_process("r1", "recorder")]
    for table, also in ((ALL, rights.of_uplink("r1")), (OF_THE_FLEET, rights.of_robot("r1"))):
        for topic in table:
            if topic.delivery is Delivery.STATE:
                history = f"{topic.at('r1', 'yard')}/@adv/**"
                assert all(asks(granted, history) for granted in (*readers, also)), topic.key


def test_an_operators_word_passes_both_routers():
    for topic in (topics.TELEOP, topics.JOYSTICK):
        key = topic.at("r1")
        assert sends(rights.of_operator(), key)
        assert may(rights.of_robot("r1"), Kind.SAMPLES, Flow.EGRESS, key)
        assert sends(rights.of_uplink("r1"), key)
    for topic in (topics.MISSION, topics.SAFETY_COMMAND):
        key = topic.at("r1")
        assert asks(rights.of_operator(), key)
        assert may(rights.of_robot("r1"), Kind.QUESTIONS, Flow.EGRESS, key)
        assert asks(rights.of_uplink("r1"), key)


def test_who_has_no_certificate_left_is_no_subject():
    subjects = control.at_server("tcp", "tls", {Role.ROBOT: {"r1": ["robot.r1.0011aabb"], "r2": []}})
    assert [subject.name for subject in subjects] == ["server", "robot r1"]
    table = control.access_control(subjects)
    assert table["default_permission"] == "deny"
    assert all(rule["permission"] == "allow" and rule["key_exprs"] for rule in table["rules"])
    assert table["subjects"][1]["cert_common_names"] == ["robot.r1.0011aabb"]


def test_rights_of_everybody_are_no_rights():
    with pytest.raises(ValueError, match="everybody"):
        control.access_control([control.Subject("anybody", rights.of_viewer())])


def test_without_passwords_processes_are_one_and_still_below_their_robot():
    (subject,) = control.at_robot("r1", "tcp", None, passwords=False)
    assert sends(subject.rights, topics.SAFE.at("r1"))
    assert not sends(subject.rights, topics.SAFE.at("r2"))
    assert not sends(subject.rights, f"vtr/{FLEET}/yard/model")


def test_every_process_of_the_table_has_rights():
    named = {process.name for process in (*ROBOT, *OPTIONAL)} - {"router"}
    assert named <= set(rights.processes())


def written(call, folder):
    """The topics that a call is written with in a folder's modules."""
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / folder).rglob("*.py"))
    return {getattr(topics, name) for name in re.findall(rf"\b_?{call}\(\s*topics\.([A-Z_]+)", text)}


@pytest.mark.parametrize("process", sorted({process.name for process in (*ROBOT, *OPTIONAL)} - {"router"}))
def test_a_service_may_do_what_its_code_does(process):
    assert all(topic.fleet or process in topic.owners for topic in written("publisher", f"services/{process}"))
    for topic in written("ask", f"services/{process}"):
        assert topic.askers == ("*",) or process in topic.askers, topic.key


def test_an_operator_may_ask_what_the_commands_ask():
    asked = set().union(*(written("ask", f"cli/{folder}") for folder in ("commands", "demo", "doctor", "views")))
    for topic in asked | {topics.MISSION, topics.PUSH, topics.FETCH, topics.REMOVE}:
        assert topic.askers == ("*",) or "operator" in topic.askers, topic.key
