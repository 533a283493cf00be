"""Vehicles with limits of every kind, and what holds from one of their commands to the next."""

from hypothesis import strategies as st

from services.tracker.limits import Drive, Limits
from services.tracker.ramp import turn_bound

ROUNDING = 1e-9
positive = st.floats(0.05, 5.0)


@st.composite
def all_limits(draw):
    """Limits of any vehicle; those on acceleration may allow much or next to nothing."""
    drive = draw(st.sampled_from(Drive))
    curvature = draw(positive if drive is Drive.ACKERMANN else st.none() | positive)
    return Limits(drive, *(draw(positive) for _ in range(6)), curvature)


def assert_possible(limits, before, after, seconds):
    """No limit on speed, turn rate, curvature or acceleration is exceeded from a command to the next."""
    (v0, w0), (v, w) = before, after
    assert abs(v) <= limits.speed + ROUNDING
    assert abs(w) <= turn_bound(v, limits) + ROUNDING
    slower, faster = (rate * seconds + ROUNDING for rate in (limits.deceleration, limits.acceleration))
    assert abs(v) - abs(v0) <= faster
    assert abs(v0) - abs(v) <= slower
    assert v * v0 >= 0.0
    assert abs(w - w0) <= limits.turn_acceleration * seconds + ROUNDING
