"""Attempts to break into a fleet that is set up as docs/security.md says: each is refused, and each is logged.

The server's, the robot's and the people's files are those of deploy/secure, on other ports.
"""

from __future__ import annotations

import re
import time
from datetime import timedelta

import numpy as np
import pytest
import structlog

from cli.__main__ import run
from common import logs, topics, wire
from common.access.names import CommonName, Role
from common.bus import Bus
from common.bus.envelope import Envelope
from common.errors import NoAnswer, NoRouter, Refused
from common.messages import (
    Announcement,
    CameraModel,
    Command,
    GraphQuery,
    MapEnds,
    SafetyCommand,
    StereoFrame,
    VelocityCommand,
    now_ns,
)
from common.objects import StorageError
from tests.integration.intruder import (
    Attempt,
    Witness,
    again,
    answer_for_the_navigator,
    ask,
    link_ends,
    logged,
    never_gets_through,
    pretend_to_be_present,
    put_anywhere,
    send,
)
from tests.integration.secured import OTHER, ROBOT, Fleet, answers, refused_at_the_door
from tests.processes import eventually, every

pytestmark = pytest.mark.usefixtures("operator")

START_S = 60.0
EXPIRED = timedelta(days=2)
PROCESSES = frozenset({"router", "navigator", "safety", "mapstore"})


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    with Fleet(tmp_path_factory.mktemp("fleet")) as fleet:
        yield fleet


@pytest.fixture(scope="module")
def operator(fleet):
    with fleet.operator.bus("operator", timeout=START_S) as bus:
        presence = bus.presence()
        eventually(lambda: presence.alive() >= PROCESSES, "the operator sees the robot's processes", START_S)
        yield bus


@pytest.fixture(scope="module")
def witness(fleet, operator):  # noqa: ARG001, who is there before it hears anything
    with fleet.robot.bus("recorder") as bus:
        yield Witness(bus)


# --- what is legitimate passes ---------------------------------------------------------------------------------------


def test_the_operator_stops_the_robot_and_commands_it_through_both_routers(operator, witness):
    status = operator.subscribe(topics.SAFETY_STATUS)
    operator.ask(topics.SAFETY_COMMAND, SafetyCommand(action="stop", reason="a test"), 5)
    eventually(lambda: (s := status.last()) and s.message.latched, "safety tells the operator that it is latched")
    operator.ask(topics.SAFETY_COMMAND, SafetyCommand(action="reset"), 5)
    with pytest.raises(Refused, match="without"):  # the navigator's own words: this robot has no sensors
        operator.ask(topics.MISSION, Command(action="teach"), 5)
    teleop = operator.publisher(topics.TELEOP)
    with every(0.05, lambda: teleop.put(VelocityCommand(stamp=now_ns(), v=0.0, w=0.0))):
        eventually(lambda: witness.of(operator), "the operator's teleoperation arrives at the robot")


def test_the_command_line_needs_nothing_but_the_file(fleet, capsys):
    assert run(["state", "--json", "--config", str(fleet.viewer.path)]) == 0
    assert '"name": "Idle"' in capsys.readouterr().out
    assert run(["estop", "--config", str(fleet.operator.path)]) == 0
    assert run(["estop", "--reset", "--config", str(fleet.operator.path)]) == 0
    assert run(["estop", "--config", str(fleet.viewer.path)]) == 1
    capsys.readouterr()
    assert (
        run(["state", "--config", str(fleet.stranger("guest", fleet.signed("viewer.x.00000000", ago=EXPIRED)).path)])
        == 1
    )
    assert "does not take this certificate" in capsys.readouterr().err


def test_the_robot_announces_to_the_server_and_hears_its_model(fleet):
    told = []
    with fleet.server.bus("fleet", topics.FLEET) as server, fleet.robot.bus("mapstore") as mapstore:

        def take(announcement):
            told.append(announcement.robot)
            raise Refused("heard")

        server.serve(topics.ANNOUNCE, take, "*")

        def announce():
            with pytest.raises((Refused, NoAnswer)):
                mapstore.ask(topics.ANNOUNCE, Announcement(environment="yard", robot=ROBOT), 1, "yard")
            return told

        assert eventually(announce, "the server hears of a map") == [ROBOT]


def test_images_leave_the_robot_less_often_than_they_are_taken(fleet, operator, witness):
    camera = CameraModel(width=16, height=16, fx=9.0, fy=9.0, cx=8.0, cy=8.0, baseline=0.2, T_vehicle_camera=np.eye(4))
    image = np.zeros((16, 16, 3), np.uint8)
    arrived = []
    operator.session.declare_subscriber(f"vtr/{ROBOT}/sensor/**", arrived.append)
    with fleet.robot.bus("sensors") as sensors:
        frames = sensors.publisher(topics.STEREO, "front")
        begin = time.monotonic()
        with every(0.01, lambda: frames.put(StereoFrame(stamp=now_ns(), camera=camera, left=image, right=image))):
            eventually(lambda: len(arrived) >= 2, "the operator sees images")
        seconds = time.monotonic() - begin
    taken = len(witness.of(sensors))
    assert taken > 2 * len(arrived)
    assert len(arrived) <= 2.0 * seconds + 2


# --- nobody gets in without a certificate that counts ----------------------------------------------------------------


def test_no_certificate(fleet):
    ca = {"root_ca_certificate": str(fleet.keys.path / "ca.pem")}
    assert refused_at_the_door(fleet.operator, **{"link/tls": ca})
    logged(fleet.server, "refused", what="link", reason="peer sent no certificates")


def test_a_self_made_certificate_of_the_right_name(fleet):
    authority = fleet.authority()
    pair = fleet.signed(fleet.common_name("alice"), authority=authority)
    assert refused_at_the_door(fleet.stranger("self-made", pair))
    logged(fleet.server, "refused", what="link", reason="invalid peer certificate: BadSignature")
    assert refused_at_the_door(fleet.stranger("self-made-both", pair, authority)), "nor does it take our server for one"


def test_an_expired_certificate(fleet):
    pair = fleet.signed(fleet.common_name("alice"), ago=EXPIRED)
    assert refused_at_the_door(fleet.stranger("expired", pair))
    logged(fleet.server, "refused", what="link", reason="invalid peer certificate: certificate expired")


def test_a_link_ends_when_its_certificate_expires(fleet):
    pair = fleet.signed(fleet.common_name("alice"), days=4 / 86400)
    with fleet.stranger("brief", pair).bus("operator") as bus:
        bus.ask(topics.SAFETY_COMMAND, SafetyCommand(action="reset"), 5)
        eventually(lambda: not bus.connected(), "the link ends")
    logged(fleet.server, "refused", what="link", reason="invalid peer certificate: certificate expired")


def test_a_certificate_that_the_register_does_not_know(fleet):
    name = CommonName.new(Role.OPERATOR, "alice")
    unknown = fleet.stranger("unknown", fleet.signed(str(name)))
    assert never_gets_through(unknown)
    logged(fleet.server, "refused", who=name, what="link", reason="the certificate is revoked")


def test_a_client_certificate_is_no_server(fleet):
    """A viewer who puts himself in the server's place is not believed."""
    own = fleet.viewer.folder / "keys"
    tls = {
        "root_ca_certificate": str(own / "ca.pem"),
        "listen_certificate": str(own / "certificate.pem"),
        "listen_private_key": str(own / "key.pem"),
        "enable_mtls": True,
    }
    with Bus("fleet", "router", f"tls/127.0.0.1:{fleet.spare_port}", mode="router", access={"transport/link/tls": tls}):
        text = fleet.operator.path.read_text()
        misled = fleet.stranger("misled")
        misled.path.write_text(re.sub(r"tls/127.0.0.1:\d+", f"tls/127.0.0.1:{fleet.spare_port}", text))
        assert refused_at_the_door(misled)


# --- who gets in does no more than is his right ----------------------------------------------------------------------


SAFE, TELEOP, STATE, MISSION = (
    f"vtr/{ROBOT}/{t.key}" for t in (topics.SAFE, topics.TELEOP, topics.STATE, topics.MISSION)
)
CANCEL = Command(action="cancel")

ATTEMPTS = [
    Attempt("a viewer drives the base", "viewer", "safety", send(topics.SAFE), SAFE),
    Attempt("a viewer teleoperates", "viewer", "operator", send(topics.TELEOP), TELEOP),
    Attempt("a viewer states what the robot does", "viewer", "navigator", put_anywhere(STATE), STATE),
    Attempt("a viewer sends to every key at once", "viewer", "safety", put_anywhere("vtr/**"), r"vtr/\*\*"),
    Attempt("a viewer commands", "viewer", "operator", ask(topics.MISSION, CANCEL), MISSION, "query"),
    Attempt(
        "a viewer resets the emergency stop", "viewer", "operator",
        ask(topics.SAFETY_COMMAND, SafetyCommand(action="reset")), f"vtr/{ROBOT}/safety/command", "query",
    ),
    Attempt(
        "a viewer removes a map", "viewer", "operator",
        ask(topics.REMOVE, GraphQuery(map="20260101T000000000000-robot-abcdef")), f"vtr/{ROBOT}/graph/remove", "query",
    ),
    Attempt(
        "a viewer is present as the navigator", "viewer", "navigator",
        pretend_to_be_present, f"vtr/{ROBOT}/alive/navigator", ".*liveliness token",
    ),
    Attempt(
        "a viewer answers for the navigator", "viewer", "navigator", answer_for_the_navigator, MISSION,
        ".*queryable",
    ),
    Attempt("an operator drives the base past safety", "operator", "safety", send(topics.SAFE), SAFE),
    Attempt("an operator states what the robot does", "operator", "navigator", put_anywhere(STATE), STATE),
    Attempt("another robot drives the base", "other", "safety", send(topics.SAFE), SAFE),
    Attempt("another robot teleoperates", "other", "operator", send(topics.TELEOP), TELEOP),
    Attempt("another robot states what this one does", "other", "navigator", put_anywhere(STATE), STATE),
    Attempt("another robot commands", "other", "operator", ask(topics.MISSION, CANCEL), MISSION, "query"),
    Attempt("the server drives the base", "server", "safety", send(topics.SAFE), SAFE),
    Attempt("the robot's tracker drives the base past safety", "tracker", "safety", send(topics.SAFE), SAFE),
    Attempt("the robot's estimator states what it does", "estimator", "navigator", put_anywhere(STATE), STATE),
]  # fmt: skip


@pytest.mark.parametrize("attempt", ATTEMPTS, ids=lambda attempt: attempt.name)
def test_what_is_not_ones_right(fleet, witness, attempt):
    local = attempt.who in ("tracker", "estimator")
    with fleet.as_(attempt.who, attempt.claims) as bus:
        attempt.do(bus)
        where = fleet.robot if local else fleet.server
        logged(where, "refused", who=fleet.known_as(attempt.who), what=attempt.what, key=attempt.key)
        assert not witness.of(bus)


@pytest.mark.parametrize("password", [None, "a guess"])
def test_a_process_on_the_robot_without_the_password(fleet, password):
    shown = None if password is None else {"user": "safety", "password": password}
    with pytest.raises(NoRouter):
        fleet.robot.bus("safety", timeout=0.8, **({"auth/usrpwd": shown} if shown else {"auth/usrpwd": {}}))
    logged(fleet.robot, "refused", what="link", reason="Recv InitSyn" if password is None else "Recv OpenSyn")


def test_a_robot_writes_below_anothers_prefix(fleet):
    mine, others = fleet.storage(OTHER), fleet.storage(ROBOT)
    eventually(lambda: answers(mine), "the storage answers", 30)
    others.put("maps", f"robots/{ROBOT}/one", b"content")
    for bucket in ("maps", "environments"):
        with pytest.raises(StorageError):
            mine.put(bucket, f"robots/{ROBOT}/one", b"forged")
    assert others.get("maps", f"robots/{ROBOT}/one") == b"content"
    logged(fleet.server, "refused", by="storage", who=OTHER, what="put", key=f"maps/robots/{ROBOT}/one")


# --- what was recorded and is sent again -----------------------------------------------------------------------------


def test_a_viewer_sends_again_what_safety_has_sent(fleet, witness):
    sample = eventually(lambda: witness.first("command/safe"), "safety sends")
    count = len([s for s in witness.samples if s.attachment.to_bytes() == sample.attachment.to_bytes()])
    with fleet.viewer.bus("operator") as viewer:
        again(viewer, sample)
        logged(fleet.server, "refused", who=fleet.known_as("viewer"), what="put", key=SAFE)
    assert len([s for s in witness.samples if s.attachment.to_bytes() == sample.attachment.to_bytes()]) == count


def test_an_operator_sends_again_what_was_teleoperated(fleet, operator, witness):
    sample = eventually(lambda: witness.first("command/teleop"), "somebody teleoperates")
    logs.configure(ROBOT, "recorder")
    with fleet.robot.bus("recorder") as robot, structlog.testing.capture_logs() as lines:
        received = robot.subscribe(topics.TELEOP)
        teleop = operator.publisher(topics.TELEOP)
        teleop.put(VelocityCommand(stamp=now_ns(), v=0.0, w=0.0))
        eventually(received.poll, "the operator teleoperates")
        with fleet.operator.bus("operator") as thief, every(0.05, lambda: again(thief, sample)):
            eventually(lambda: received.poll() or robot.statistics.collect()[1].get(TELEOP), "it is counted")
    assert received.last().message.stamp > 0
    assert any(line["event"] == "samples dropped" and line["reason"] == "out of sequence" for line in lines)


def test_an_operator_asks_again_what_was_asked(fleet, operator):
    payload = wire.encode(SafetyCommand(action="reset"))
    envelope = Envelope.seal(payload, operator.source, 1_000_000, now_ns()).pack()

    def asked():
        key = f"vtr/{ROBOT}/safety/command"
        return next(iter(operator.session.get(key, payload=payload, attachment=envelope, timeout=5)))

    assert asked().ok is not None
    assert b"it is a replay" in asked().err.payload.to_bytes()
    logged(fleet.robot, "samples dropped", by="safety", reason=".*it is a replay")


def test_who_has_stolen_the_robots_key_sends_again_what_it_has_stated(fleet, operator, witness):
    states = operator.subscribe(topics.STATE)
    old = eventually(lambda: witness.first("state"), "the robot states")
    eventually(states.poll, "the operator hears a newer state")
    with fleet.as_("robot", "navigator") as thief, every(0.05, lambda: again(thief, old)):

        def dropped():
            states.last()
            return operator.statistics.collect()[1].get(STATE)

        assert eventually(dropped, "the operator's session counts what is out of sequence")


# --- what is taken back ----------------------------------------------------------------------------------------------


def test_a_revoked_certificate_is_put_out_and_does_not_come_back(fleet, operator):
    name = fleet.common_name("victor")
    with fleet.viewer.bus("operator") as viewer:
        fleet.keys.revoke("victor")
        eventually(lambda: fleet.server.ended("router"), "the router ends, to be started anew")
        fleet.server.start("router")
        logged(fleet.server, "refused", who=name, what="link", reason="the certificate is revoked")
        with link_ends(viewer):
            pass
    assert never_gets_through(fleet.viewer)
    presence = operator.presence()
    eventually(lambda: presence.alive() >= PROCESSES, "the operator is linked to the robot again", 30)
    operator.ask(topics.SAFETY_COMMAND, SafetyCommand(action="stop"), 5)


def test_a_revoked_robot_writes_nothing_more_into_the_storage(fleet):
    storage = fleet.storage(OTHER)
    storage.put("maps", f"robots/{OTHER}/one", b"content")
    fleet.keys.revoke(OTHER)
    for service in ("router", "storage"):
        eventually(lambda service=service: fleet.server.ended(service), f"{service} ends, to be started anew")
        fleet.server.start(service)
    eventually(lambda: answers(fleet.storage(ROBOT)), "the storage answers the other robot again", 30)
    with pytest.raises(StorageError, match="InvalidAccessKeyId"):
        storage.put("maps", f"robots/{OTHER}/two", b"content")
    logged(fleet.server, "refused", by="storage", who="a stranger", what="put", key=f"maps/robots/{OTHER}/two")


def test_a_renewed_certificate_takes_the_place_of_the_old(fleet):
    fleet.keys.renew("alice", 2, revoke=True)
    eventually(lambda: fleet.server.ended("router"), "the router ends, to be started anew")
    fleet.server.start("router")
    old = fleet.operator
    assert never_gets_through(old)
    with fleet.stranger("renewed").bus("operator", timeout=START_S) as bus:
        logged(fleet.server, "linked", who=fleet.common_name("alice"))
        assert bus.connected()


def test_a_conquered_server_still_does_no_more_than_an_operator(fleet, witness):
    """Last, for it takes the server's place: its own certificate, its own port, and no access control at all."""
    with fleet.conquered_server() as server:
        presence = server.presence()
        eventually(lambda: presence.alive() >= PROCESSES, "the robot is linked to what it takes for its server", 30)
        send(topics.SAFE)(server)
        send(topics.DESIRED)(server)
        ask(topics.ENDS, MapEnds(map="20260101T000000000000-robot-abcdef"))(server)
        who = fleet.common_name("central")
        for key, what in ((SAFE, "put"), (f"vtr/{ROBOT}/command/desired", "put"), (f"vtr/{ROBOT}/graph/ends", "query")):
            logged(fleet.robot, "refused", who=who, what=what, key=key)
        assert not witness.of(server)
