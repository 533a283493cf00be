"""What an intruder does, and how a test sees that it was refused."""

from __future__ import annotations

import contextlib
import dataclasses
import queue
import re
from collections.abc import Callable

import pytest
import zenoh

from common import topics, wire
from common.bus import Bus
from common.bus.envelope import Envelope
from common.errors import NoAnswer, NoRouter
from common.messages import SafetyCommand, VelocityCommand, now_ns
from tests.integration.secured import ROBOT
from tests.processes import DEADLINE_S, eventually

ASK_S = 0.4


class Witness:
    """Hears all that arrives at the robot, and by whom it says it was sent."""

    def __init__(self, bus):
        self.samples = []
        self._subscriber = bus.session.declare_subscriber(f"vtr/{ROBOT}/**", self.samples.append)

    def of(self, bus):
        """The samples of a session."""
        return [s for s in list(self.samples) if s.attachment and self._source(s).life == bus.source.life]

    def first(self, key):
        """The first sample of a topic."""
        return next((s for s in list(self.samples) if str(s.key_expr) == f"vtr/{ROBOT}/{key}"), None)

    def _source(self, sample):
        return Envelope.open(sample.attachment.to_bytes(), sample.payload.to_bytes()).source


def logged(machine, event, **fields):
    """Waits until a process of a machine has logged an event with these fields, each a regular expression."""
    process = fields.pop("by", "router")
    wanted = [rf'\bevent="?{event}', *(rf'\b{key}="?{value}' for key, value in fields.items())]

    def line():
        return any(all(re.search(field, text) for field in wanted) for text in machine.log(process).splitlines())

    try:
        eventually(line, f"{process} of {machine.folder.name} logs {wanted}")
    except AssertionError as error:
        pytest.fail(f"{error}:\n{machine.log(process)[-3000:]}")


@contextlib.contextmanager
def link_ends(bus):
    """Within the block, or soon after it, the session's link ends; milliseconds later the session tries again."""
    events = queue.SimpleQueue()
    listener = bus.session.info.declare_link_events_listener(events.put)
    try:
        yield
        while events.get(timeout=DEADLINE_S).kind != zenoh.SampleKind.DELETE:
            pass
    except queue.Empty:
        pytest.fail(f"the link has not ended within {DEADLINE_S:g} s")
    finally:
        listener.undeclare()


def never_gets_through(machine):
    """Whether a session that may have begun cannot ask anything, and ends."""
    try:
        with machine.bus("operator", timeout=0.8) as bus, link_ends(bus), pytest.raises((NoAnswer, NoRouter)):
            bus.ask(topics.SAFETY_COMMAND, SafetyCommand(action="reset"), ASK_S)
    except NoRouter:
        pass
    return True


@dataclasses.dataclass(frozen=True)
class Attempt:
    """Somebody with a certificate, or a process with a password, does what is not its right.

    ``claims`` is the process that it says it is; ``key`` and ``what`` are what its router has to log.
    """

    name: str
    who: str
    claims: str
    do: Callable[[Bus], object]
    key: str
    what: str = "put"


def send(topic):
    def do(bus):
        message = VelocityCommand(stamp=now_ns(), v=0.5, w=0.0)
        bus.publisher(topic).put(message)

    return do


def ask(topic, question):
    def do(bus):
        with pytest.raises(NoAnswer):
            bus.ask(topic, question, ASK_S)

    return do


def put_anywhere(key):
    def do(bus):
        payload = wire.encode(VelocityCommand(stamp=now_ns(), v=0.5, w=0.0))
        bus.session.put(key, payload, attachment=Envelope.seal(payload, bus.source, 1, now_ns()).pack())

    return do


def pretend_to_be_present(bus):
    bus.present()


def answer_for_the_navigator(bus):
    bus.serve(topics.MISSION, lambda _: pytest.fail("a viewer was asked in the navigator's place"))


def again(bus, sample):
    bus.session.put(str(sample.key_expr), sample.payload.to_bytes(), attachment=sample.attachment.to_bytes())
