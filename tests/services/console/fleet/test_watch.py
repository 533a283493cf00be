"""The fleet as the page follows it: over a real router, whoever is there or not."""

import threading

import pytest

from common import messages as m
from common import topics
from common.bus import Bus, Publisher
from common.errors import Refused
from common.topics import FLEET
from services.console.errors import ConsoleError
from services.console.fleet.watch import Watch
from tests.common.environment.thesis import EXPERIMENT_2, EXPERIMENT_3
from tests.processes import Robot, eventually
from tests.services.console.fleet.standin import StandIn, entries, model


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("console")) as robot:
        yield robot


@pytest.fixture
def server(robot):
    with Bus(FLEET, FLEET, robot.endpoint, shared_memory=False, timeout=10) as bus:
        yield StandIn(bus)


@pytest.fixture
def watch(robot):
    """Followed by a thread, as the page does it."""
    stop = threading.Event()
    with Bus("r1", "console", robot.endpoint, shared_memory=False, timeout=10) as bus:
        watch = Watch(bus, stop, "linked to no fleet")
        thread = threading.Thread(target=lambda: watch.run(lambda: True))
        thread.start()
        yield watch
        stop.set()
        thread.join()


def soon(watch, name, condition, what):
    """Waits until what is known of an environment is so."""

    def found():
        known = watch.snapshot.environments.get(name)
        return known if known is not None and condition(known) else None

    return eventually(found, what)


def test_without_a_server_the_page_says_so_and_when_one_comes_it_is_there(watch, robot):
    eventually(lambda: watch.snapshot.missing == "linked to no fleet", "it says so")
    with pytest.raises(ConsoleError, match="linked to no fleet"):
        watch.look("campus")
    with Bus(FLEET, FLEET, robot.endpoint, shared_memory=False, timeout=10) as bus:
        StandIn(bus).environments["campus"] = entries(EXPERIMENT_2)
        eventually(lambda: watch.snapshot.maps == {"campus": 9} and not watch.snapshot.missing, "it is found")
        assert len(watch.look("campus").entries) == 9
        with pytest.raises(ConsoleError, match="no environment 'moon'; it has campus"):
            watch.look("moon")
    eventually(lambda: watch.snapshot.missing, "it is missed")
    assert len(watch.look("campus").entries) == 9, "what was known stays"


def test_a_new_map_a_new_model_and_its_spectrum_arrive_by_themselves(watch, server):
    server.environments["campus"] = entries(EXPERIMENT_3)
    eventually(lambda: "campus" in watch.snapshot.maps, "the environment is known")
    assert watch.look("campus").told is None
    server.learn(model())
    first = soon(watch, "campus", lambda known: known.spectrum is not None, "model and spectrum have come")
    assert first.model.periods_hours == (24.0,)
    server.environments["campus"] = entries([*EXPERIMENT_3, ("map4", "G", "H", "2023-05-07 22:00:00", 12.0)])
    second = soon(watch, "campus", lambda known: len(known.entries) == 4, "the map has come")
    assert second.version > first.version
    server.learn(model(revision=2, periods_hours=[12.0]))
    third = soon(watch, "campus", lambda known: known.model.periods_hours == (12.0,), "the new model has come")
    assert third.spectrum.revision == 2
    server.asked.clear()
    eventually(lambda: server.asked.count("environments") >= 2, "it is asked again")
    assert set(server.asked) == {"environments"}, "only what may have changed"
    assert watch.snapshot.environments["campus"].version == third.version


def test_similarities_are_those_of_a_route(watch, server):
    server.environments["campus"] = [*entries(EXPERIMENT_2), *entries(EXPERIMENT_3)]
    assert len(watch.similarities("campus", ("s", "g")).maps) == 3
    with pytest.raises(Refused, match="no maps have been compared"):
        watch.similarities("campus", ("a", "c"))


def test_robots_of_other_names_are_seen_with_their_states_while_somebody_looks(watch, robot):
    state = m.State(stamp=1, name=m.StateName.REPEAT_FOLLOW, environment="farm", since=1, reason="to the gate")
    with Bus("r7", "navigator", robot.endpoint, shared_memory=False, timeout=10) as bus:
        bus.present()
        publisher = bus.publisher(topics.STATE)

        def shown():
            publisher.put(state)
            return watch.snapshot.states.get("r7")

        assert eventually(shown, "its state is told").reason == "to the gate"
        assert watch.snapshot.present["r7"] == {"navigator"}
        Publisher(bus, topics.STATE, topics.STATE.at("r1")).put(state)
    eventually(lambda: "r7" not in watch.snapshot.present, "it has gone")
    assert "r1" not in watch.snapshot.states, "a robot tells of itself alone"


def test_one_robot_alone_can_be_looked_at(robot):
    with (
        Bus("r1", "console", robot.endpoint, shared_memory=False, timeout=10) as bus,
        Bus("r8", "navigator", robot.endpoint, shared_memory=False, timeout=10) as other,
    ):
        bus.present()
        other.present()
        watch = Watch(bus, threading.Event(), robots="r1")

        def seen():
            watch.hear()
            return watch.snapshot.present

        eventually(lambda: "console" in seen().get("r1", ()), "it sees itself")
        assert "r8" not in seen()


def test_nobody_is_asked_while_nobody_looks(robot, server):
    server.environments["campus"] = entries(EXPERIMENT_3)
    stop, looked = threading.Event(), threading.Event()

    def watched():
        looked.set()
        return False

    with Bus("r1", "console", robot.endpoint, shared_memory=False, timeout=10) as bus:
        watch = Watch(bus, stop)
        thread = threading.Thread(target=lambda: watch.run(watched))
        thread.start()
        assert looked.wait(5)
        looked.clear()
        assert looked.wait(5)
        stop.set()
        thread.join()
    assert server.asked == []
