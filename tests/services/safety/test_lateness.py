"""What a message spent on its way is told without two clocks that agree, and a clock that is set changes nothing."""

import pytest

from services.safety.lateness import Lateness

CLOCK = 1.7e9
"""Seconds between the sender's clock and the receiver's monotonic time."""


class Link:
    """Messages of one sender, sent and received at times of the receiver's clock."""

    def __init__(self, sender="operator"):
        self.lateness, self.sender, self.clock = Lateness(), sender, CLOCK

    def late(self, sent, way=0.1):
        return self.lateness.of(self.sender, round((sent + self.clock) * 1e9), sent + way)


def test_a_steady_link_is_late_by_its_jitter_alone():
    link = Link()
    ways = [0.1, 0.12, 0.1, 0.15, 0.11]
    found = [link.late(0.05 * k, way) for k, way in enumerate(ways)]
    assert found == pytest.approx([0.0, 0.02, 0.0, 0.05, 0.01], abs=1e-5)


@pytest.mark.parametrize("stall", [2.0, 12.0, 300.0])
def test_what_a_stalled_link_delivers_is_as_late_as_it_is(stall):
    link = Link()
    for k in range(1000):
        link.late(0.05 * k)
    begins = 50.0
    burst = [link.late(sent, begins + stall - sent) for sent in (begins, begins + 0.5, begins + 1.0)]
    assert burst == pytest.approx([stall - 0.1, stall - 0.6, stall - 1.1], abs=1e-5)
    assert link.late(begins + stall + 0.1) == pytest.approx(0.0, abs=1e-5)


def test_asked_again_for_the_same_message_it_says_the_same():
    link = Link()
    link.late(0.0)
    assert [link.late(1.0, 3.1) for _ in range(3)] == pytest.approx([3.0] * 3, abs=1e-5)


@pytest.mark.parametrize("step", [-3600.0, -0.2, 0.2, 3600.0])
def test_a_clock_that_is_set_changes_nothing(step):
    link = Link()
    for k in range(20):
        link.late(0.05 * k)
    link.clock += step
    assert [link.late(1.0 + 0.05 * k) for k in range(20)] == pytest.approx([0.0] * 20, abs=1e-5)


def test_a_clock_that_runs_slow_for_an_hour_does_not_age_what_it_stamps():
    link, worst = Link(), 0.0
    for k in range(7200):
        link.clock -= 0.5 * 500e-6
        worst = max(worst, link.late(0.5 * k))
    assert worst < 0.05


def test_another_sender_is_compared_with_itself():
    link = Link()
    link.late(0.0)
    link.sender, link.clock = "console", CLOCK - 500.0
    assert link.late(1.0) == 0.0
