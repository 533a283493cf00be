"""What safety's log says of stops."""

from structlog.testing import capture_logs

from services.safety.rules import Cause, Effect, Reason
from services.safety.stop_log import StopLog

STALE = Reason(Cause.ODOMETRY_STALE, Effect.STOP, "No odometry for 0.62 s.")
LATER = Reason(Cause.ODOMETRY_STALE, Effect.STOP, "No odometry for 0.64 s.")
FAR = Reason(Cause.METRES_UNLOCALIZED, Effect.SLOW, "4 m without a localization.")


def lines(cycles):
    stops = StopLog()
    with capture_logs() as logged:
        for now, reasons, passing in cycles:
            stops.cycle(now, reasons, passing=passing)
    return [(entry["event"], entry.get("reasons")) for entry in logged]


def test_a_stop_is_told_once_with_its_reasons_and_its_end_too():
    stop, go = ("the robot is stopped", [STALE.sentence]), ("commands pass", None)
    assert lines([(0.0, [], True), (5.0, [STALE], False), (5.02, [LATER], False), (8.0, [FAR], True)]) == [go, stop, go]


def test_stops_that_follow_one_another_closely_fill_no_disk():
    cycles = [(0.1 * k, [STALE] if k % 2 else [], k % 2 == 0) for k in range(100)]
    assert 9 <= len(lines(cycles)) <= 11
