"""A dead man's switch that is far away: words that a stalled link delivers late hold nothing."""

import pytest

from common import topics
from common.messages import Joystick, StateName, now_ns
from tests.processes import Robot, every
from tests.services.safety.crew import Crew

_STALE_NS = 700_000_000
_STEP_NS = 1_000_000


@pytest.fixture
def crew(tmp_path):
    with Robot(tmp_path, "[safety.rules]\ndead_mans_switch = true\n") as robot:
        crew = Crew(robot)
        robot.start("safety")
        with every(0.03, crew.publish):
            yield crew


class Hand:
    """Says that the switch is held, with the stamp of when it was said."""

    def __init__(self, crew):
        self._stick = crew.operator.publisher(topics.JOYSTICK)
        self.stamp = 0
        self.stalled = False

    def say(self):
        self.stamp = self.stamp + _STEP_NS if self.stalled else now_ns()
        self._stick.put(Joystick(stamp=self.stamp, axes=[], held=True, buttons=[]))


def test_held_of_before_is_not_held_now(crew):
    hand = Hand(crew)
    with crew.state_is(StateName.TEACH_BRANCH):
        with every(0.05, hand.say):
            crew.until(lambda safe: safe.v < -0.3, "the operator drives")
        crew.until(lambda safe: safe.v == 0.0 and now_ns() - hand.stamp > _STALE_NS, "the robot stands")
        hand.stalled = True
        with every(0.05, hand.say):
            speeds = [received.message.v for _ in range(40) if (received := crew.safe.wait(1.0)) is not None]
            _, rules = crew.until_status(lambda status: not status.passing, "a status")
        assert set(speeds) == {0.0}
        assert "dead_mans_switch" in rules
        hand.stalled = False
        with every(0.05, hand.say):
            crew.until(lambda safe: safe.v < -0.3, "the operator drives again")
