from __future__ import annotations

import os
import signal
import threading

import pytest

from common import topics, wire
from common.bus import Bus
from common.bus.envelope import Envelope, Source
from common.errors import BusError, GraphError, MalformedMessage, NoAnswer, NoRouter, Refused
from common.messages import Command, Done, Goal, GraphQuery, State, StateName, VelocityCommand
from common.topics import Delivery
from tests import fuzz
from tests.processes import Robot, eventually, free_port

WAIT_S = 10.0


def command(v: float) -> VelocityCommand:
    return VelocityCommand(stamp=1, v=v, w=0.0)


def state(reason: str) -> State:
    return State(stamp=1, name=StateName.IDLE, environment="park", since=1, reason=reason)


def put_until_received(publisher, subscription, message):
    """A frame that is put before the subscriber is known to the router is lost, as frames may be."""

    def received():
        publisher.put(message)
        return subscription.wait(0.05)

    return eventually(received, f"{subscription.topic.key} is received")


def drops(bus: Bus, key: str) -> int:
    return bus.statistics.collect()[1].get(key, 0)


def test_of_frames_the_latest_wins(connect):
    receiver, sender = connect("safety"), connect("tracker")
    slow, reader = receiver.subscribe(topics.DESIRED), receiver.subscribe(topics.DESIRED)
    publisher = sender.publisher(topics.DESIRED)
    put_until_received(publisher, reader, command(0))
    for v in range(1, 21):
        publisher.put(command(v))
    eventually(lambda: (last := reader.last()) and last.message.v == 20, "the last frame arrives")
    eventually(lambda: (newest := slow.poll()) and newest.message.v == 20, "the slow reader gets the last frame")
    assert slow.poll() is None
    assert slow.last().message.v == 20


def test_two_publishers_of_one_session_are_one_sequence(connect):
    sender, subscription = connect("tracker"), connect("safety").subscribe(topics.DESIRED)
    first = sender.publisher(topics.DESIRED)
    for v in range(5):
        put_until_received(first, subscription, command(v))
    second = sender.publisher(topics.DESIRED)
    assert put_until_received(second, subscription, command(9)).message.v == 9
    assert put_until_received(first, subscription, command(10)).message.v == 10


def test_one_name_does_not_hide_another(connect):
    bus, example = connect("tracker"), fuzz.valid_examples()[topics.HEALTH]
    everybody = bus.subscribe(topics.HEALTH)
    last = bus.subscribe(topics.HEALTH, "planner")
    for name in ("tracker", "safety", "planner"):
        bus.publisher(topics.HEALTH, name).put(example)
    eventually(last.last, "the last report arrives")
    keys = set()
    eventually(lambda: (one := everybody.poll()) and (keys.add(one.key) or len(keys) == 3), "three reports arrive")


def test_states_arrive_in_order_and_a_late_joiner_gets_the_last(connect):
    navigator, early = connect("navigator"), connect("safety")
    subscription = early.subscribe(topics.STATE)
    publisher = navigator.publisher(topics.STATE)
    put_until_received(publisher, subscription, state("ready"))
    for i in range(50):
        publisher.put(state(str(i)))
    assert [subscription.wait(WAIT_S).message.reason for _ in range(50)] == [str(i) for i in range(50)]
    late = connect("tracker").subscribe(topics.STATE)
    assert late.wait(WAIT_S).message.reason == "49"
    assert late.fresh().reason == "49"
    publisher.put(state("next"))
    assert late.wait(WAIT_S).message.reason == "next"


def test_arrivals_wake_the_loop_and_age(connect):
    bus, wake = connect("tracker"), threading.Event()
    subscription = bus.subscribe(topics.DESIRED, wake=wake)
    assert subscription.age() == float("inf")
    assert subscription.fresh() is None
    bus.publisher(topics.DESIRED).put(command(1))
    assert wake.wait(WAIT_S)
    received = subscription.last()
    assert subscription.age(received.arrival + 3.0) == pytest.approx(3.0)
    assert received.source.process == "tracker"


@pytest.fixture
def stranger(connect):
    """Puts any bytes on a topic's key."""
    session = connect("stranger").session

    def put(topic, payload: bytes, attachment: bytes | None, name: str = "front") -> None:
        session.put(topic.at("r1", name), payload, attachment=attachment)

    return put


def test_samples_out_of_sequence_or_of_another_are_dropped_and_counted(connect, stranger):
    bus, key = connect("safety"), topics.DESIRED.at("r1")
    subscription, payload = bus.subscribe(topics.DESIRED), wire.encode(command(7))
    tracker = Source.of("r1", "tracker")

    def sealed(source=tracker, sequence=5, **changes):
        return Envelope.seal(payload, source, sequence, 1)._replace(**changes).pack()

    def accepted():
        stranger(topics.DESIRED, payload, sealed(Source.of("r1", "tracker"), 0))
        return subscription.wait(0.05)

    eventually(accepted, "the stranger's link is up")
    stranger(topics.DESIRED, payload, sealed())
    assert subscription.wait(WAIT_S).source == tracker
    for attachment in (
        sealed(),
        sealed(sequence=4),
        sealed(Source.of("r1", "planner"), 9),
        sealed(Source.of("r2", "tracker"), 9),
        sealed(sequence=9, schema=99),
        sealed(sequence=9, checksum=1),
        b"junk",
        None,
    ):
        before = drops(bus, key)
        stranger(topics.DESIRED, payload, attachment)
        eventually(lambda before=before: subscription.poll() is None and drops(bus, key) == before + 1, "it is dropped")
    stranger(topics.DESIRED, payload, sealed(sequence=6))
    assert subscription.wait(WAIT_S).message.v == 7


def test_a_malformed_sample_does_not_use_up_sequence_numbers(connect, stranger):
    bus, tracker = connect("safety"), Source.of("r1", "tracker")
    subscription = bus.subscribe(topics.DESIRED)
    before = drops(bus, topics.DESIRED.at("r1"))

    def dropped():
        stranger(topics.DESIRED, b"junk", Envelope.seal(b"junk", tracker, 2**63 - 1, 1).pack())
        return subscription.poll() is None and drops(bus, topics.DESIRED.at("r1")) > before

    eventually(dropped, "the malformed sample is dropped")
    payload = wire.encode(command(1))
    stranger(topics.DESIRED, payload, Envelope.seal(payload, tracker, 1, 1).pack())
    assert subscription.wait(WAIT_S).message.v == 1


@pytest.mark.parametrize(
    "topic", [t for t in topics.ALL if t.delivery is not Delivery.QUERY], ids=lambda topic: topic.key
)
def test_no_random_sample_is_received(connect, stranger, topic):
    bus, example = connect("recorder"), fuzz.valid_examples()[topic]
    subscription, recorder = bus.subscribe(topic), bus.subscribe(topic)
    owner = "tracker" if topic.owners == ("*",) else topic.owners[0]
    source, payload = Source.of("r1", owner), wire.encode(example)
    recorded = (payload, Envelope.seal(payload, source, 3, 1).pack())

    def linked():
        stranger(topic, *recorded)
        return recorder.poll()

    eventually(linked, "the stranger's link is up")
    eventually(subscription.last, "the first sample arrives")
    for sample in fuzz.samples(topic, "r1", 300, recorded=recorded):
        stranger(topic, sample.payload, sample.attachment)
        assert subscription.poll() is None
    last = Envelope.seal(payload, source, 4, 1).pack()
    stranger(topic, payload, last)
    received = subscription.wait(WAIT_S)
    assert received.source == source
    assert subscription.poll() is None


def test_a_question_is_answered_or_refused_with_the_answerers_sentence(connect):
    def handle(question: Command) -> Done:
        if question.goal.to == "nowhere":
            raise GraphError("there is no place 'nowhere'")
        if question.goal.to == "bug":
            raise ZeroDivisionError
        return Done(text=question.goal.to)

    server, asker = connect("navigator"), connect("operator")
    server.serve(topics.MISSION, handle)

    def ask(goal):
        return asker.ask(topics.MISSION, Command(action="repeat", goal=Goal(to=goal)), timeout=WAIT_S)

    def answered():
        try:
            return ask("gate")
        except NoAnswer:
            return None

    assert eventually(answered, "the question is answered").text == "gate"
    with pytest.raises(Refused, match=r"^there is no place 'nowhere'$"):
        ask("nowhere")
    with pytest.raises(Refused, match="navigator could not answer 'mission/command'"):
        ask("bug")
    assert ask("still there").text == "still there"


def test_malformed_questions_are_refused_and_counted(connect):
    served = []
    server, asker = connect("navigator"), connect("operator")
    server.serve(topics.MISSION, lambda question: served.append(question) or Done())
    key, count = topics.MISSION.at("r1"), 0
    eventually(lambda: list(asker.session.get(key, payload=b"", timeout=WAIT_S)), "the question is answered")
    before = drops(server, key)
    for sample in fuzz.samples(topics.MISSION, "r1", 200):
        replies = list(asker.session.get(key, payload=sample.payload, attachment=sample.attachment, timeout=WAIT_S))
        assert [reply.ok for reply in replies] == [None]
        count += 1
    assert not served
    assert drops(server, key) == before + count


def test_nobody_serves_or_not_in_time(connect):
    server, asker = connect("mapstore"), connect("planner")
    with pytest.raises(NoAnswer, match=r"'plan'.* is planner running"):
        asker.ask(topics.PLAN, fuzz.valid_examples()[topics.PLAN], timeout=WAIT_S)
    release, asked = threading.Event(), threading.Event()

    def slow(_question: GraphQuery) -> Done:
        asked.set()
        release.wait(WAIT_S)
        return Done()

    server.serve(topics.REMOVE, slow)

    def unanswered():
        with pytest.raises(NoAnswer):
            asker.ask(topics.REMOVE, GraphQuery(), timeout=0.1)
        return asked.is_set()

    eventually(unanswered, "the question reaches the slow handler")
    release.set()
    assert eventually(lambda: asker.ask(topics.REMOVE, GraphQuery(), timeout=WAIT_S), "it answers again") == Done()


def test_an_answer_of_another_type_is_malformed(connect):
    server, asker = connect("mapstore"), connect("planner")
    server.serve(topics.NAME_PLACE, lambda _: command(1))

    def answer():
        try:
            asker.ask(topics.NAME_PLACE, fuzz.valid_examples()[topics.NAME_PLACE], timeout=WAIT_S)
        except MalformedMessage:
            return True
        except NoAnswer:
            return False

    eventually(answer, "the wrong answer arrives")


def test_presence_of_a_process_that_is_killed_and_of_one_that_leaves(robot, connect):
    wake = threading.Event()
    presence = connect("observer").presence(wake)
    robot.stand_in("estimator")
    eventually(lambda: "estimator" in presence, "the process is present")
    assert presence.since("estimator") is not None
    wake.clear()
    robot.kill("estimator")
    assert wake.wait(WAIT_S)
    eventually(lambda: "estimator" not in presence, "the process is gone")
    assert presence.since("estimator") is None
    assert "router" in presence.alive()


def test_a_process_is_present_while_any_of_its_lives_is(robot, connect):
    first, presence = connect("planner"), connect("observer").presence()
    first.present()
    robot.stand_in("planner")
    eventually(lambda: "planner" in presence, "both are present")
    robot._processes["planner"].kill()
    robot._processes["planner"].wait()
    marker = connect("marker")
    marker.present()
    eventually(lambda: "marker" in presence, "what comes after the death is seen")
    assert "planner" in presence


def test_a_life_is_known_while_its_session_is_open_on_this_robot_alone(robot, connect):
    lives = connect("observer").lives()
    tracker = connect("tracker")
    eventually(lambda: tracker.source in lives, "the life is known")
    assert Source("r1", "tracker", "another") not in lives
    tracker.close()
    eventually(lambda: tracker.source not in lives, "the life is over")
    with Bus("r2", "tracker", robot.endpoint, shared_memory=False) as stranger:
        after = connect("tracker")
        eventually(lambda: after.source in lives, "a later life is known")
        assert stranger.source not in lives


def test_lives_are_known_again_when_the_router_was_killed_and_is_back(tmp_path):
    with Robot(tmp_path) as robot:
        tracker, lives = robot.bus("tracker"), robot.bus("safety").lives()
        eventually(lambda: tracker.source in lives, "the life is known")
        robot.kill("router")
        eventually(lambda: tracker.source not in lives, "nobody is known")
        robot.start("router")
        eventually(lambda: tracker.source in lives, "the life is known again")


def test_all_flows_again_when_the_router_was_killed_and_is_back(tmp_path):
    with Robot(tmp_path) as robot:
        sender, receiver = robot.bus("navigator"), robot.bus("safety")
        states = receiver.subscribe(topics.STATE)
        sender.serve(topics.MISSION, lambda question: Done(text=question.goal.to))
        frames, desired = receiver.subscribe(topics.DESIRED), robot.bus("tracker").publisher(topics.DESIRED)
        publisher, presence = sender.publisher(topics.STATE), receiver.presence()
        sender.present()
        put_until_received(publisher, states, state("before"))
        eventually(lambda: "navigator" in presence, "the sender is present")
        for _ in range(2):
            robot.kill("router")
            eventually(lambda: not presence.alive(), "everybody is gone")
            with pytest.raises(NoRouter, match=robot.endpoint):
                eventually(lambda: receiver.ask(topics.MISSION, Command(action="pause"), timeout=0.2), "no answer")
            publisher.put(state("while away"))
            robot.start("router")
            eventually(lambda: "navigator" in presence, "the sender is back")
            eventually(lambda: (got := states.last()) and got.message.reason == "while away", "the state is caught up")
            put_until_received(publisher, states, state("after"))
            put_until_received(desired, frames, command(1))
            answer = eventually(lambda: _ask(receiver, "gate"), "questions are answered again")
            assert answer.text == "gate"


def _ask(bus: Bus, goal: str) -> Done | None:
    try:
        return bus.ask(topics.MISSION, Command(action="repeat", goal=Goal(to=goal)))
    except BusError:
        return None


def test_a_frozen_router_is_noticed(tmp_path):
    with Robot(tmp_path) as robot:
        bus = robot.bus("safety")
        process = robot._processes["router"]
        os.kill(process.pid, signal.SIGSTOP)
        eventually(lambda: not bus.connected(), "the link is given up")
        os.kill(process.pid, signal.SIGCONT)
        eventually(bus.connected, "the link is back")


def test_without_a_router_a_session_that_does_not_wait_says_so():
    with pytest.raises(NoRouter, match=r"no router answers at tcp/127\.0\.0\.1") as caught:
        Bus("r1", "operator", f"tcp/127.0.0.1:{free_port()}", timeout=0.2)
    assert "\n" not in str(caught.value)


def test_a_port_in_use_is_said_in_one_sentence(robot):
    with pytest.raises(BusError, match="port in use") as caught:
        Bus("r1", "router", robot.endpoint, mode="router")
    assert "\n" not in str(caught.value)


def test_a_closed_subscription_hears_nothing_more_and_others_do(connect):
    publisher, receiver = connect("navigator").publisher(topics.STATE), connect("safety")
    closed, other = receiver.subscribe(topics.STATE), receiver.subscribe(topics.STATE)
    publisher.put(state("first"))
    assert closed.wait(WAIT_S).message.reason == other.wait(WAIT_S).message.reason == "first"
    closed.close()
    closed.close()
    publisher.put(state("second"))
    assert other.wait(WAIT_S).message.reason == "second"
    assert closed.poll() is None
    assert closed.last().message.reason == "first"


def test_a_fleet_that_comes_later_than_the_robot_is_found():
    fleet, own = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with (
        Bus("r1", "router", own, mode="router", uplink=fleet),
        Bus("r1", "navigator", own, shared_memory=False) as robot,
    ):
        robot.present()
        with (
            Bus("fleet", "router", fleet, mode="router"),
            Bus("r1", "operator", fleet, shared_memory=False) as operator,
        ):
            presence = operator.presence()
            eventually(lambda: "navigator" in presence, "the robot is seen through the fleet's router", 30)
